"""Aliases of a camera beside ``current``, such as ``canary``: where they lead, and each of their moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple
from uuid import UUID

from sqlalchemy import exists, func, select
from sqlalchemy.orm import Session, aliased

from service.calibration_runs.gate_verdicts import gate_verdict
from service.db.aliases import AliasMove
from service.db.calibrations import Result


class Words(NamedTuple):
    """Who publishes and why. ``overridden`` holds the objections, if it is published against any."""

    person_id: UUID | None
    reason: str | None
    overridden: Sequence[str] = ()


class OfCamera(NamedTuple):
    """Whose camera."""

    fleet_id: UUID
    vehicle_id: UUID
    camera: str


def move_alias(session: Session, of: OfCamera, alias: str, result: Result | None, words: Words) -> AliasMove:
    """Let an alias lead to a result, or nowhere. The caller holds the vehicle's publications."""
    moves = (AliasMove.vehicle_id == of.vehicle_id, AliasMove.camera == of.camera, AliasMove.alias == alias)
    last = session.scalar(select(func.max(AliasMove.number)).where(*moves)) or 0
    row = AliasMove(
        **of._asdict(),
        alias=alias,
        number=last + 1,
        result_id=result.id if result else None,
        led_to=result.id if result else None,
        said_by=words.person_id,
        reason=words.reason or "",
        overridden=list(words.overridden) or None,
        gate=gate_verdict(session, result) if result else None,
    )
    session.add(row)
    session.flush()
    return row


def newest_moves(session: Session, vehicle_id: UUID, camera: str) -> Sequence[AliasMove]:
    """The last move of each alias of a camera, by name; includes removed aliases."""
    of_camera = (AliasMove.vehicle_id == vehicle_id, AliasMove.camera == camera)
    last = select(AliasMove.alias, func.max(AliasMove.number).label("number")).where(*of_camera)
    last = last.group_by(AliasMove.alias).subquery()
    return session.scalars(
        select(AliasMove)
        .join(last, (AliasMove.alias == last.c.alias) & (AliasMove.number == last.c.number))
        .where(*of_camera)
        .order_by(AliasMove.alias)
    ).all()


def aliases_to(session: Session, vehicle_id: UUID, calibrations: Sequence[UUID]) -> list[tuple[str, str]]:
    """The aliases that lead to a result of one of these calibrations, each with its camera."""
    later = aliased(AliasMove)
    has_moved_on = exists().where(
        *(later.vehicle_id == AliasMove.vehicle_id, later.camera == AliasMove.camera),
        *(later.alias == AliasMove.alias, later.number > AliasMove.number),
    )
    rows = session.execute(
        select(AliasMove.alias, AliasMove.camera)
        .join(Result, Result.id == AliasMove.result_id)
        .where(AliasMove.vehicle_id == vehicle_id, Result.calibration_id.in_(calibrations), ~has_moved_on)
        .order_by(AliasMove.alias, AliasMove.camera)
    )
    return [(alias, camera) for alias, camera in rows]
