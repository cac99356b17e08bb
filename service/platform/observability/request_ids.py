"""One id that follows a request: through the API, onto the rows of the jobs that it causes, into the workers' logs.

It is the caller's ``X-Request-ID`` where that is harmless, else a fresh one. It is a field of the log, so every line
has it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from uuid import uuid4

from structlog.contextvars import bind_contextvars, bound_contextvars, get_contextvars

HEADER = "X-Request-ID"
LONGEST = 64
_NAME = HEADER.lower().encode()
_FIELD = "request_id"

_HARMLESS = re.compile(rf"[A-Za-z0-9._-]{{1,{LONGEST}}}")


def bind(headers: Iterable[tuple[bytes, bytes]]) -> str:
    """Return the id of a request with these headers. The rest of this context works for it."""
    caller_id = next((value.decode("latin-1") for name, value in headers if name == _NAME), "")
    # It stands in log lines and rows.
    request_id = caller_id if _HARMLESS.fullmatch(caller_id) else uuid4().hex
    bind_contextvars(**{_FIELD: request_id})
    return request_id


def current() -> str | None:
    """The id of the request that the present code works for, or None."""
    return get_contextvars().get(_FIELD)


def working_for(request_id: str | None) -> AbstractContextManager[None]:
    """Add the request's id to everything that the block logs and queues."""
    return bound_contextvars(**{_FIELD: request_id}) if request_id else nullcontext()
