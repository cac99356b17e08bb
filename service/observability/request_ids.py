"""One id that follows a request: through the API, onto the rows of the jobs that it causes, into the workers' logs.

The id is the caller's ``X-Request-ID`` where that is harmless, else a fresh one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from uuid import uuid4

HEADER = "X-Request-ID"
SCOPE = "apexcal.request_id"
LONGEST = 64

_HARMLESS = re.compile(rf"[A-Za-z0-9._-]{{1,{LONGEST}}}")
_current: ContextVar[str | None] = ContextVar("apexcal_request_id", default=None)


def accepted(given: str | None) -> str:
    """``given`` where it can stand in a log line and a row, else a fresh id."""
    return given if given and _HARMLESS.fullmatch(given) else uuid4().hex


def current() -> str | None:
    """The id of the request that the present code works for, or None."""
    return _current.get()


@contextmanager
def working_for(request_id: str | None) -> Iterator[None]:
    """Whatever happens in the block is done for this request."""
    token = _current.set(request_id)
    try:
        yield
    finally:
        _current.reset(token)
