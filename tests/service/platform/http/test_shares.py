"""Whatever changes or sends something works within the share of who asks, in each thread that it uses."""

from __future__ import annotations

import threading
from collections import defaultdict
from functools import partial
from typing import Any

import anyio.to_thread

from service.platform.db.base import new_id
from service.platform.http import threads
from service.platform.observability import request_ids
from tests.service.platform.auth.test_every_route import fill, routes, send
from tests.support.databases import one_database
from tests.support.people import Api

READS = ("get", "head")
# These keep nothing: all that they do is to work on the bytes that came with them.
PARSING = {
    "/v1/calibration-files/reading",
    "/v1/recordings/{recording_id}/rig-proposals",
    "/v1/results/{result_id}/comparison",
    "/v1/results/{result_id}/urdf",
    "/v1/vehicles/{vehicle_id}/cameras/{camera}/calibration/urdf",
    "/v1/rigs/{rig_id}/correspondence-sets",
}


def test_one_person_has_one_thing_parsed_at_a_time_and_a_process_two() -> None:
    gate, inside = threading.Event(), threading.Semaphore(0)

    def parse() -> None:
        inside.release()
        assert gate.wait(60)

    async def run() -> None:
        lanes, people = threads.Threads(), [new_id() for _ in range(4)]
        async with anyio.create_task_group() as group:
            for person in (*people, *people):
                group.start_soon(partial(lanes.parse, parse, caller=person))
            for _ in range(2):
                await anyio.to_thread.run_sync(inside.acquire)
            assert await lanes.reading.run(lambda: "read", caller=people[0]) == "read", "readers are free"
            assert not inside.acquire(blocking=False), "a third is parsed"
            gate.set()

    anyio.run(run)


@one_database
def test_no_request_with_a_body_uses_a_thread_without_a_share(api: Api, monkeypatch) -> None:
    """The look at who asks is the exception: nothing is known of them yet."""
    fleet = api.fleet()
    api.member(fleet, "admin")
    with api.database.writing() as session:
        rows = fill(session, fleet)
    lanes = {id(lane): name for name, lane in vars(api.app.state.threads).items()}
    uses: dict[tuple[str, str], list[tuple[str, Any]]] = defaultdict(list)
    present: list[tuple[str, str]] = [("", "")]
    run, parse, run_sync = threads.Lane.run, threads.Threads.parse, anyio.to_thread.run_sync
    parsing: set[str] = set()

    async def noted_parse(self: threads.Threads, *args: Any, caller: Any) -> Any:
        parsing.add(present[0][1])
        return await parse(self, *args, caller=caller)

    async def noted(self: threads.Lane, call: Any, *args: Any, caller: Any = None, **named: Any) -> Any:
        shares = None if self._limiter._each is None else caller
        if request_ids.current():
            uses[present[0]].append((lanes[id(self)], shares))
        return await run(self, call, *args, caller=caller, **named)

    async def outside(*args: Any, **named: Any) -> Any:
        if request_ids.current():  # the upkeep has none
            uses[present[0]].append(("outside of all lanes", None))
        return await run_sync(*args, **named)

    monkeypatch.setattr(threads.Lane, "run", noted)
    monkeypatch.setattr(threads.Threads, "parse", noted_parse)
    # The lanes have a name of their own for it.
    monkeypatch.setattr(anyio.to_thread, "run_sync", outside)
    asked = [(method, path, operation) for method, path, operation in routes() if method not in READS]
    for method, path, operation in asked:
        present[0] = (method, path)
        send(api, None if path == "/v1/sign-in" else api.owner(), method, path, operation, rows)
    assert len(asked) > 50
    shareless = {use: lanes for use, lanes in uses.items() if any(a != "identity" and not b for a, b in lanes)}
    assert not shareless
    assert parsing == PARSING
