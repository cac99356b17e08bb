"""How processes log: lines for people, or one JSON object a line for machines, each with the id of its request.

A line never holds a query string, a header or a body, so no secret gets into it by way of a request. What cannot be
seen is escaped here, for all lines: a name or path from outside must not begin a line of its own or order a terminal.
"""

from __future__ import annotations

import json
import logging
import sys
from datetime import UTC, datetime
from time import localtime, strftime
from typing import Any

from structlog.contextvars import bind_contextvars, bound_contextvars, get_contextvars

from apexcal.documents.base import visible

# Celery says of every message that it came and that it went; the job's own lines say more.
_CHATTY = ("celery.worker.strategy", "celery.app.trace")

about = bound_contextvars
"""``with about(job=7):`` lines logged in the block carry these fields."""
say_who = bind_contextvars
"""``say_who(person=...)``: lines of the rest of this request carry these fields."""
who = get_contextvars
"""The fields of the present request or job."""


def formatter(form: str) -> logging.Formatter:
    """Return the formatter that makes lines of records, as ``json`` or ``text``."""
    return _Objects() if form == "json" else _Lines()


class _Objects(logging.Formatter):
    """An object a line."""

    def format(self, record: logging.LogRecord) -> str:
        """The fields of an object in their order."""
        own = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat().replace("+00:00", "Z"),
            "level": record.levelname,
            "logger": record.name,
            "process": record.process,
            "message": record.getMessage(),
        }
        return visible(_JSON.encode({**own, **get_contextvars(), **_extras(record), **_below(self, record)}))


class _Lines(logging.Formatter):
    """A line for people, what it is about in brackets; below it a traceback, indented: it may look like a line."""

    def format(self, record: logging.LogRecord) -> str:
        """A line, or several."""
        time = strftime("%Y-%m-%d %H:%M:%S", localtime(record.created))
        context = " ".join(f"{name}={value}" for name, value in get_contextvars().items())
        about = f" [{context}]" if context else ""
        first = visible(f"{time} {record.levelname} {record.name}{about} {record.getMessage()}")
        below = _below(self, record).values()
        return "\n".join([first, *(f"  {visible(line)}" for text in below for line in text.split("\n"))])


_JSON = json.JSONEncoder(default=str, ensure_ascii=False)
_USUAL = frozenset(logging.makeLogRecord({}).__dict__) | {"message", "asctime", "taskName"}


def _extras(record: logging.LogRecord) -> dict[str, Any]:
    """Return the caller's fields beside the message. Uvicorn's messages come a second time there, with colours."""
    extras = ((name, value) for name, value in record.__dict__.items() if name not in _USUAL)
    return {name: value for name, value in extras if not name.startswith(("color_", "_"))}


def _below(formatter: logging.Formatter, record: logging.LogRecord) -> dict[str, str]:
    """The traceback and the stack, where the record has them."""
    texts = {}
    if record.exc_info and record.exc_info[0] is not None:
        texts["exception"] = formatter.formatException(record.exc_info)
    if record.stack_info:
        texts["stack_info"] = record.stack_info
    return texts


def configure(form: str, level: int = logging.INFO) -> None:
    """Log everything of this process to standard error, as ``json`` or ``text``. Once per process, at its start."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(formatter(form))
    # No line says where in the code, by which thread it was written (Python's HOWTO, "Optimization").
    logging._srcfile = None  # pyright: ignore[reportAttributeAccessIssue]
    logging.logThreads = logging.logMultiprocessing = False
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
