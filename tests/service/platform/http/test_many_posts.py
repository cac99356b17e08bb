"""POSTs at once: none waits for a second thread while it holds the database; each that creates honours its key."""

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from inspect import unwrap
from pathlib import Path
from typing import Any
from uuid import uuid4

from sqlalchemy import func, select

from service.app import ROUTERS
from service.platform.db.fleets import Vehicle
from tests.support.people import Api

# More than the threads that the server has for them (anyio's default: 40).
AT_ONCE = 60
ALONE = 5


def test_more_keyed_posts_than_threads_end(api: Api) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")

    def add(number: int) -> int:
        headers = {"Idempotency-Key": str(uuid4())}
        return engineer.post(f"/fleets/{fleet}/vehicles", {"name": f"van {number}"}, headers=headers).status_code

    began = time.monotonic()
    assert [add(number) for number in range(AT_ONCE, AT_ONCE + ALONE)] == [201] * ALONE
    one_by_one_s = (time.monotonic() - began) * AT_ONCE / ALONE
    began = time.monotonic()
    with ThreadPoolExecutor(AT_ONCE) as pool:
        answers = list(pool.map(add, range(AT_ONCE)))
    assert answers == [201] * AT_ONCE
    # SQLite waits 30 s for its lock; a request that holds it and waits for a thread held the others as long.
    assert time.monotonic() - began < one_by_one_s + 20
    with api.database.reading() as session:
        assert session.scalar(select(func.count()).select_from(Vehicle)) == AT_ONCE + ALONE


# What a second POST finds done already, so that a key has nothing to add: (end of the path) -> why.
NATURAL = {
    "/sign-in": "a link signs in once, and its session is never shown again",
    "/sign-out": "a session that ended stays ended",
    "/address": "the same part of the same size and digest goes to the same place",
    "/arrival": "a part that arrived has arrived",
    "/cancel": "what was asked to end is asked to end",
    "/tasks/next": "the vertex that one holds is handed out again",
    "/crops/next": "the page that one holds is handed out again",
    "/answer": "the id that its client made says whether it is the same answer",
    "/undo": "as /answer",
    "/reading": "nothing is kept: what the sent files hold is answered",
    "/comparison": "nothing is kept: what was sent is compared",
    "/rig-proposals": "nothing is kept: a rig to send is answered",
    "/urdf": "nothing is kept: what was sent is answered with one joint changed",
}


def endpoints(router) -> Iterator[tuple[str, Any]]:
    """Path and function of every POST route, included routers too."""
    for route in router.routes:
        if hasattr(route, "original_router"):
            yield from endpoints(route.original_router)
        elif "POST" in route.methods:
            yield route.path, unwrap(route.endpoint)


def keeps_its_answer(endpoint: Any) -> bool:
    """Whether the function, or one of its own module that it calls, answers through ``Access.answer``."""
    names = endpoint.__code__.co_names
    called = [endpoint.__globals__.get(name) for name in names]
    return "answer" in names or any(
        "answer" in one.__code__.co_names
        for one in called
        if hasattr(one, "__code__") and one.__module__ == endpoint.__module__
    )


def test_every_post_honours_its_key_or_needs_none() -> None:
    posts = [found for router in ROUTERS for found in endpoints(router)]
    assert len(posts) > 25
    unsaid = [path for path, one in posts if not keeps_its_answer(one) and not path.endswith(tuple(NATURAL))]
    assert not unsaid
    said = (Path(__file__).parents[4] / "docs/api.md").read_text()
    assert all(f"`{end}`" in said for end in NATURAL), "docs/api.md names those that need none"
