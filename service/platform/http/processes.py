"""A process beside an API process, for parsing that a stranger's bytes may make long.

In a thread, such work would take the interpreter from other requests at each of their some 25 turns.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from anyio import BrokenWorkerProcess, from_thread, to_process

from service.platform.http.problems import Problem

ValueT = TypeVar("ValueT")


def in_process(call: Callable[..., ValueT], *args: Any) -> ValueT:
    """Return the result of ``call`` in another process. Arguments, result and errors are pickled.

    It is called in one of the API's threads.

    Raises:
        Problem: 503 ``reading_ended`` if the process ended; or what ``call`` raises.
    """
    try:
        return from_thread.run(partial(to_process.run_sync, _quietly, call, *args))
    except BrokenWorkerProcess:
        raise Problem(
            503,
            "reading_ended",
            "The process that reads files ended before it had read these.",
            "Send them again. If it ends again, they are what ends it: send fewer of them.",
            headers={"Retry-After": "2"},
        ) from None


def _quietly(call: Callable[..., ValueT], *args: Any) -> ValueT:
    os.nice(19)
    return call(*args)
