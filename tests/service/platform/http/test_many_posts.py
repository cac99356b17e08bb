"""Each POST that creates honours its key."""

from collections.abc import Iterator
from inspect import unwrap
from pathlib import Path
from typing import Any

from service.app import ROUTERS

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
