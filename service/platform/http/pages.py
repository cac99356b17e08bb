"""Cursor pagination: a list is answered a hundred rows at a time, and each page names where the next one begins."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from typing import Annotated, Any
from uuid import UUID

from fastapi import Depends, Query, Request, Response
from pydantic import BaseModel
from sqlalchemy import ColumnElement, Select, select, union_all
from sqlalchemy.orm import InstrumentedAttribute, Session

from apexcal.documents.base import Page as Page
from service.platform.http.problems import Problem, unprocessable

_AFTER = "the `next` of the page before"
# A cursor may hold two names of 200 letters of up to 4 bytes, in base64.
_LONGEST = 4000
_LIMIT = "how many at most"


class Window(BaseModel):
    """The part of a list that a request names."""

    after: str | None = None
    limit: int = 100


async def _window(
    after: Annotated[str | None, Query(max_length=_LONGEST, description=_AFTER)] = None,
    limit: Annotated[int, Query(ge=1, le=100, description=_LIMIT)] = 100,
) -> Window:
    return Window(after=after, limit=limit)


async def _long_window(
    after: Annotated[str | None, Query(max_length=_LONGEST, description=_AFTER)] = None,
    limit: Annotated[int, Query(ge=1, le=5000, description=_LIMIT)] = 100,
) -> Window:
    return Window(after=after, limit=limit)


Paging = Annotated[Window, Depends(_window)]
LongPaging = Annotated[Window, Depends(_long_window)]


def fetch(
    session: Session,
    statement: Select[Any],
    key: InstrumentedAttribute[Any],
    window: Window,
    *,
    newest_first: bool = False,
    any_of: Sequence[ColumnElement[bool]] = (),
) -> tuple[list[Any], str | None]:
    """Return the rows of one page of ``statement``, and its ``next``.

    ``any_of``: conditions of which each row fulfils one, each with an index that sorts by ``key``. A page of each
    condition is read, and the first rows of all are returned; with one OR a database would sort or scan everything.

    ``key`` is a column that is unique within the statement, a UUID (version 7: sorted by time) or an integer; it
    gives the order. A statement of one entity gives entities; of several it gives rows, ``key`` being the first's.
    Raises :class:`Problem` ``invalid_cursor``.
    """
    if window.after is not None:
        edge = _parse(key, window.after)
        statement = statement.where(key < edge if newest_first else key > edge)
    order = key.desc() if newest_first else key
    if len(any_of) == 1:
        statement = statement.where(*any_of)
    elif any_of:
        ids = statement.with_only_columns(key.label("key"))
        parts = [ids.where(condition).order_by(order).limit(window.limit + 1).subquery() for condition in any_of]
        statement = statement.where(key.in_(union_all(*(select(part.c.key) for part in parts))))
    statement = statement.order_by(None).order_by(order).limit(window.limit + 1)
    single = len(statement.column_descriptions) == 1
    rows: list[Any] = list(session.scalars(statement) if single else session.execute(statement))
    if len(rows) <= window.limit:
        return rows, None
    rows = rows[: window.limit]
    last = getattr(rows[-1] if single else rows[-1][0], key.key)
    return rows, last.hex if isinstance(last, UUID) else str(last)


def _parse(key: InstrumentedAttribute[Any], text: str) -> UUID | int:
    kind: type[Any] = key.type.python_type
    try:
        if kind is UUID:
            return UUID(hex=text)
        number = int(text)
        if abs(number) >= 2**63:
            raise ValueError(text)
        return number
    except ValueError:
        raise invalid_cursor(text) from None


def invalid_cursor(cursor: str) -> Problem:
    """Return the problem of an ``after`` that no page of the list gave."""
    hint = "Give the `next` of a page as it is, with the same query."
    return unprocessable("invalid_cursor", f"`after` is no cursor of this list: {cursor!r}.", hint)


def compressed(request: Request, document: BaseModel) -> Response:
    """Return a document as JSON, by gzip if the client takes it, at its quickest level: lists shrink to a fifth."""
    body, headers = document.model_dump_json().encode(), {"Vary": "Accept-Encoding"}
    if "gzip" in request.headers.get("accept-encoding", ""):
        body, headers["Content-Encoding"] = gzip.compress(body, 1), "gzip"
    return Response(body, media_type="application/json", headers=headers)
