"""One id that follows a request: through the API, onto the rows of the jobs that it causes, into the workers' logs.

``asgi_correlation_id`` takes the caller's ``X-Request-ID`` where that is harmless, else makes a fresh one. It is a
field of the log, so every line has it.
"""

from __future__ import annotations

import re
from contextlib import AbstractContextManager, nullcontext

from structlog.contextvars import bind_contextvars, bound_contextvars, get_contextvars

HEADER = "X-Request-ID"
LONGEST = 64
_FIELD = "request_id"

_HARMLESS = re.compile(rf"[A-Za-z0-9._-]{{1,{LONGEST}}}")


def is_harmless(given: str) -> bool:
    """Whether a caller's id can stand in a log line and a row."""
    return bool(_HARMLESS.fullmatch(given))


def bound(request_id: str) -> str:
    """The id, which the rest of this context works for now."""
    bind_contextvars(**{_FIELD: request_id})
    return request_id


def current() -> str | None:
    """The id of the request that the present code works for, or None."""
    return get_contextvars().get(_FIELD)


def working_for(request_id: str | None) -> AbstractContextManager[None]:
    """Whatever happens in the block is done for this request."""
    return bound_contextvars(**{_FIELD: request_id}) if request_id else nullcontext()
