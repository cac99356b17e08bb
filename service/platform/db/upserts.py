"""Rows that several processes may be the first to write."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from service.platform.db.base import Base


def put(
    session: Session,
    model: type[Base],
    key: Mapping[str, Any],
    values: Mapping[str, Any] | None = None,
    *,
    first: Mapping[str, Any] | None = None,
) -> None:
    """Write ``values`` to the row with this key, and make it with ``first`` besides if nobody has.

    Neither of two that do so at once fails. ``key`` names a primary or unique key's columns.
    """
    insert: Any = {"postgresql": postgresql.insert, "sqlite": sqlite.insert}[session.get_bind().dialect.name]
    statement = insert(model).values(**(first or {}), **key, **(values or {}))
    if values:
        statement = statement.on_conflict_do_update(index_elements=list(key), set_=dict(values))
    else:
        statement = statement.on_conflict_do_nothing(index_elements=list(key))
    session.execute(statement.execution_options(synchronize_session=False))
