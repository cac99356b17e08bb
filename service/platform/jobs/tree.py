"""The tree of work: shards of a detection, bundles of a run, runs of a calibration, vehicles of a fleet request.

A node (:class:`Work`) counts the parts that have not ended, under its row's lock: of two that end at the same moment
the second sees the first. What stands here are statements over sets of nodes; a single one is a set too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from functools import cache
from typing import Any, Final
from uuid import UUID

from sqlalchemy import ColumnElement, Row, Update, bindparam, select, update
from sqlalchemy.orm import Session

from apexcal.documents.states import UNENDED, WorkState
from service.platform.broker.hints import hint
from service.platform.db.base import Json, Work
from service.platform.db.clock import now

LOCK_ORDER: Final = (
    *("fleet_request", "job", "recording", "detection", "correspondence_set", "calibration_run", "calibration"),
    *("vehicle", "fleet_request_vehicle", "fleet"),
)
"""Tables in the order in which every transaction locks their rows; several rows of a table in the order of their ids.

A vehicle of a request that has no work under way, because it lacks a calibration or its calibration failed, is locked
before the pairs that it is calibrated from.
"""


def end(
    session: Session,
    model: type[Work],
    ids: Collection[UUID],
    state: WorkState,
    problem: Json | None = None,
    **columns: Any,
) -> Sequence[Row[UUID, UUID]]:
    """End those of these nodes that have not ended; return the fleet and the shown id of each.

    A node shows with its parent, if it has one, or else by itself. ``columns`` are set beside.
    """
    if not ids:
        return []
    _hold(session, model, ids)
    values = {"nodes": list(ids), "ended_as": state, "because": problem}
    values |= {f"new_{name}": value for name, value in columns.items()}
    ended = session.connection().execute(_ending(model, *columns), values).all()
    for row in ended:
        hint(session, row.fleet_id, model.PARENT or model.__tablename__, row.shown_id)
    return ended


def count_down(session: Session, model: type[Work], parts: Iterable[UUID]) -> list[UUID]:
    """Take ended parts, each named by its node, off the nodes that have not ended. Return those without any left."""
    counts = Counter(parts)
    _hold(session, model, counts)
    last: list[UUID] = []
    for count in sorted(set(counts.values())):
        values = {"nodes": [node for node in counts if counts[node] == count], "parts": count}
        counted = session.connection().execute(_counting(model), values)
        last += [row.id for row in counted if row.remaining == 0]
    return last


def _hold(session: Session, model: type[Work], ids: Collection[UUID]) -> None:
    """Lock several nodes in the order of their ids. The statement about a single one locks it."""
    if len(ids) > 1:
        session.execute(select(model.id).where(model.id.in_(ids)).order_by(model.id).with_for_update()).all()


def _unended(model: type[Work]) -> tuple[ColumnElement[bool], ...]:
    return model.id.in_(bindparam("nodes", expanding=True)), model.state.in_(UNENDED)


# Built once, as those of :mod:`service.platform.jobs.claims`.
@cache
def _ending(model: type[Work], *columns: str) -> Update:
    values = {"state": bindparam("ended_as"), "problem": bindparam("because"), "finished_at": now()}
    values |= {name: bindparam(f"new_{name}") for name in columns}
    shown = getattr(model, f"{model.PARENT}_id") if model.PARENT else model.id
    return update(model).where(*_unended(model)).values(values).returning(model.fleet_id, shown.label("shown_id"))


@cache
def _counting(model: type[Work]) -> Update:
    values = {"remaining": model.remaining - bindparam("parts"), "state": WorkState.RUNNING}
    return update(model).where(*_unended(model)).values(values).returning(model.id, model.remaining)
