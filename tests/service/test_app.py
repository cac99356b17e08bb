"""The service's own tasks end with it, at whatever moment it is stopped."""

import asyncio

from service.app import create_app
from service.platform.settings import Settings
from tests.support.databases import one_database


@one_database
def test_no_task_outlives_the_service(settings: Settings) -> None:
    """Redis-py loses a cancellation that meets an answer of the broker; so the service is stopped at many moments."""
    app = create_app(settings)

    async def run() -> None:
        async with asyncio.timeout(60):
            for turns in range(100):
                async with app.router.lifespan_context(app):
                    for _ in range(turns % 50):
                        await asyncio.sleep(0.0001)
                # The broker's client closes its socket in a task of its own. One that stays lasts until the limit.
                while asyncio.all_tasks() != {asyncio.current_task()}:
                    await asyncio.sleep(0.001)

    asyncio.run(run())
