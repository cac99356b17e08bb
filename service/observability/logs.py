"""How processes log: lines for people, or one JSON object a line for machines, each with the id of its request.

A line never holds a query string, a header or a body, so no secret gets into it by way of a request. What cannot be
seen is escaped here, for all lines: a name or path from outside must not begin a line of its own or order a terminal.
"""

from __future__ import annotations

import json
import logging
import sys
from typing import Any

from structlog.contextvars import bound_contextvars, merge_contextvars
from structlog.processors import ExceptionRenderer, JSONRenderer, TimeStamper
from structlog.stdlib import ExtraAdder, ProcessorFormatter
from structlog.typing import EventDict, Processor

# Celery says of every message that it came and that it went; the job's own lines say more.
_CHATTY = ("celery.worker.strategy", "celery.app.trace")

about = bound_contextvars
"""``with about(job=7):`` lines logged in the block carry these fields."""


def visible(text: str) -> str:
    """The text with everything that cannot be seen spelled as in JSON: line ends, escapes, directions, surrogates."""
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else json.dumps(one)[1:-1] for one in text)


def formatter(form: str) -> ProcessorFormatter:
    """What makes a line of a record, as ``json`` or ``text``."""
    return ProcessorFormatter(processors=_JSON if form == "json" else _TEXT, foreign_pre_chain=[merge_contextvars])


def _without_extras_of_others(_: Any, __: str, line: EventDict) -> EventDict:
    """Uvicorn gives its messages a second time, with colours."""
    return {name: value for name, value in line.items() if not name.startswith(("color_", "_")) or name == "_record"}


def _as_object(_: Any, __: str, line: EventDict) -> EventDict:
    """The fields of an object in their order."""
    record: logging.LogRecord = line.pop("_record")
    return {
        "time": line.pop("time"),
        "level": record.levelname,
        "logger": record.name,
        "process": record.process,
        "message": line.pop("event"),
        **line,
    }


def _as_text(_: Any, __: str, line: EventDict) -> str:
    """A line for people, what it is about in brackets; below it a traceback, indented: it may look like a line."""
    record: logging.LogRecord = line.pop("_record")
    time, event = line.pop("time"), line.pop("event")
    below = [text for name in ("exception", "stack_info") if (text := line.pop(name, None))]
    found = " ".join(f"{name}={value}" for name, value in line.items() if not name.startswith("_"))
    first = visible(f"{time} {record.levelname} {record.name}{f' [{found}]' if found else ''} {event}")
    return "\n".join([first, *(f"  {visible(one)}" for text in below for one in text.split("\n"))])


def _all_visible(_: Any, __: str, line: Any) -> str:
    return visible(line)


_JSON: tuple[Processor, ...] = (
    ExtraAdder(),
    _without_extras_of_others,
    TimeStamper(fmt="iso", key="time"),
    ExceptionRenderer(),
    _as_object,
    JSONRenderer(default=str, ensure_ascii=False),
    _all_visible,
)
_TEXT: tuple[Processor, ...] = (
    TimeStamper(fmt="%Y-%m-%d %H:%M:%S", utc=False, key="time"),
    ExceptionRenderer(),
    _as_text,
)


def configure(form: str, level: int = logging.INFO) -> None:
    """Log everything of this process to standard error, as ``json`` or ``text``. Once per process, at its start."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(formatter(form))
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
    # It warns of every id that it replaces, and a stranger may send any number of them.
    logging.getLogger("asgi_correlation_id").setLevel(logging.ERROR)
