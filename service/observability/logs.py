"""How processes log: lines for people, or one JSON object a line for machines, each with the id of its request.

A line never holds a query string, a header or a body, so no secret gets into it by way of a request. What cannot be
seen is escaped here, for all lines: a name or path from outside must not begin a line of its own or order a terminal.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from service.observability import request_ids

_TEXT = "%(asctime)s %(levelname)s %(name)s%(about)s %(message)s"
# What every record has; anything else was given with `extra` and belongs into the object.
_USUAL = frozenset((*vars(logging.makeLogRecord({})), "about", "message", "asctime", "taskName"))
# Celery says of every message that it came and that it went; the job's own lines say more.
_CHATTY = ("celery.worker.strategy", "celery.app.trace")

_about: ContextVar[dict[str, Any]] = ContextVar("apexcal_log_about", default={})  # noqa: B039 - never changed


@contextmanager
def about(**fields: Any) -> Iterator[None]:
    """Lines logged in the block carry these fields, for example the job that they are about."""
    token = _about.set({**_about.get(), **fields})
    try:
        yield
    finally:
        _about.reset(token)


def _fields() -> dict[str, Any]:
    request_id = request_ids.current()
    return {**({"request_id": request_id} if request_id else {}), **_about.get()}


def visible(text: str) -> str:
    """The text with everything that cannot be seen spelled as in JSON: line ends, escapes, directions, surrogates."""
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else json.dumps(one)[1:-1] for one in text)


class JsonLines(logging.Formatter):
    """One JSON object a line: time (UTC), level, logger, message, what it is about, and a traceback where one is."""

    def format(self, record: logging.LogRecord) -> str:
        """The record as a line."""
        more = {name: value for name, value in vars(record).items() if name not in _USUAL}
        line: dict[str, Any] = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created)) + f".{int(record.msecs):03d}Z",
            "level": record.levelname,
            "logger": record.name,
            "process": record.process,
            **_fields(),
            "message": record.getMessage(),
            **{name: value for name, value in more.items() if not name.startswith(("_", "color_"))},
        }
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return visible(json.dumps(line, default=str, ensure_ascii=False))


class TextLines(logging.Formatter):
    """Lines for people; what a line is about stands in brackets."""

    def __init__(self) -> None:
        super().__init__(_TEXT)

    def format(self, record: logging.LogRecord) -> str:
        """The record as a line, and its traceback below."""
        found = " ".join(f"{name}={value}" for name, value in _fields().items())
        record.about = f" [{found}]" if found else ""
        return super().format(record)

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's own name
        """The line itself, which is one."""
        return visible(super().formatMessage(record))

    def formatException(self, ei: Any) -> str:  # noqa: N802
        """The traceback, indented: what an error says may look like a line of the log."""
        return _indented(super().formatException(ei))

    def formatStack(self, stack_info: str) -> str:  # noqa: N802
        """A stack, indented too."""
        return _indented(super().formatStack(stack_info))


def _indented(text: str) -> str:
    return "\n".join("  " + visible(line) for line in text.split("\n"))


def configure(form: str, level: int = logging.INFO) -> None:
    """Log everything of this process to standard error, as ``json`` or ``text``. Once per process, at its start."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonLines() if form == "json" else TextLines())
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level)
    logging.captureWarnings(True)
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access", "celery", "celery.task"):
        logger = logging.getLogger(name)
        logger.handlers.clear()
        logger.propagate = True
    # Ours says the same with the request's id, and without query strings.
    logging.getLogger("uvicorn.access").disabled = True
    for name in _CHATTY:
        logging.getLogger(name).setLevel(logging.WARNING)
