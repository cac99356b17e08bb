"""The service's own tasks end with it, at whatever moment it is stopped."""

import asyncio
import time
from typing import Any

import pytest

from service import app as service_app
from service.app import create_app
from service.platform.settings import Settings
from tests.support.databases import one_database


@one_database
def test_no_task_outlives_the_service(settings: Settings) -> None:
    """Redis-py loses a cancellation that meets an answer of the broker; so the service is stopped at many moments."""
    app = create_app(settings)

    async def run() -> None:
        async with asyncio.timeout(60):
            for turns in range(50):
                async with app.router.lifespan_context(app):
                    for _ in range(turns):
                        await asyncio.sleep(0.0001)
                # The broker's client closes its socket in a task of its own. One that stays lasts until the limit.
                while asyncio.all_tasks() != {asyncio.current_task()}:
                    await asyncio.sleep(0.001)

    asyncio.run(run())


def test_a_part_of_the_upkeep_that_takes_long_comes_rarely(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quick part comes at each round; one of 0.2 s comes again after 4 s at the earliest."""
    ran: list[str] = []
    rounds = asyncio.Event()

    def quick(_: Any) -> None:
        ran.append("quick")
        if ran.count("quick") == 10:
            loop.call_soon_threadsafe(rounds.set)

    def slow(_: Any) -> None:
        ran.append("slow")
        time.sleep(0.2)

    loop = asyncio.new_event_loop()

    async def run() -> None:
        unused: Any = None
        upkeep = asyncio.create_task(service_app._keep_house(unused, (slow, quick), 0.01))
        await asyncio.wait_for(rounds.wait(), 4)
        upkeep.cancel()

    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        runner.run(run())
    assert ran == ["slow", *["quick"] * 10]
