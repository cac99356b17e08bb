"""Which vehicles a filter names, and which pairs of each are the newest. A handful of queries, however many vehicles,
and a look or two for each camera, however long its history.

The rule of the newest pairs: of the vehicle's rigs (those that the filter names) the one with the newest
correspondence set; of this rig, for each of its cameras, the camera's newest set, imported or made of marks. A set
that was brought again is as new as that.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from fnmatch import translate
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import ColumnElement, ScalarSelect, exists, func, select, true
from sqlalchemy.orm import InstrumentedAttribute, Session

from apexcal.documents.fleet_requests import VehicleFilter
from apexcal.documents.publications import CURRENT
from apexcal.documents.states import WorkState
from service.platform.db.base import state_literal
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Publication, Result
from service.platform.db.fleets import Rig, RigCamera, Vehicle, natural_order
from service.platform.http.problems import Problem, unprocessable


@dataclass(frozen=True)
class Chosen:
    """A vehicle that the filter names, and the newest set of each camera of one rig; none where it has no pairs."""

    id: UUID
    name: str
    sets: Mapping[str, UUID] = field(default_factory=dict)


class _Newest(NamedTuple):
    """The newest set of a camera; they sort by when it was made or last brought."""

    at: datetime
    set_id: UUID
    vehicle_id: UUID
    rig_id: UUID
    rig: str
    camera: str


def choose(session: Session, fleet_id: UUID, chooser: VehicleFilter) -> list[Chosen]:
    """The vehicles of a fleet that the filter names, in the order of their names: 2 before 10.

    Empty where vehicles are named, and of those none is due by ``not_calibrated_since`` and ``new_pairs``: a quiet
    night is no mistake, a pattern that matches nothing is one.

    Raises:
        Problem: 422 ``unknown_vehicle``, ``no_vehicle_matches``.
    """
    vehicles = _vehicles(session, fleet_id, chooser)
    if chooser.rig:
        with_rig = _with_rig(session, fleet_id, chooser.rig)
        vehicles = {id: name for id, name in vehicles.items() if id in with_rig}
    if not vehicles:
        raise _no_match(session, fleet_id)
    chosen = with_newest_sets(session, fleet_id, vehicles, chooser.rig)
    if chooser.not_calibrated_since:
        recent = _calibrated_since(session, fleet_id, chooser.not_calibrated_since)
        chosen = [vehicle for vehicle in chosen if vehicle.id not in recent]
    if chooser.new_pairs:
        published = _published_sets(session, fleet_id)
        chosen = [
            vehicle
            for vehicle in chosen
            if any(published.get((vehicle.id, c)) != of for c, of in vehicle.sets.items())
        ]
    return sorted(chosen, key=lambda vehicle: (natural_order(vehicle.name), vehicle.name, vehicle.id))


# More rigs are read with all others of the fleet: their ids would be a statement of many kilobytes.
_FEW = 200


def with_newest_sets(
    session: Session, fleet_id: UUID, vehicles: Mapping[UUID, str], rig_pattern: str | None
) -> list[Chosen]:
    """These vehicles, by id and name, with their newest sets."""
    only = Rig.vehicle_id.in_(vehicles) if len(vehicles) <= _FEW else true()
    newest = _newest_sets(session, only & (Rig.fleet_id == fleet_id), rig_pattern)
    return [Chosen(id, name, newest.get(id, {})) for id, name in vehicles.items()]


def _no_match(session: Session, fleet_id: UUID) -> Problem:
    count = session.scalar(select(func.count()).where(Vehicle.fleet_id == fleet_id))
    return unprocessable(
        "no_vehicle_matches",
        f"The filter matches none of the fleet's vehicles, of which there are {count}.",
        "Widen the filter; an empty one means all vehicles. Give a part of the name, or a pattern with * or ?.",
    )


def _vehicles(session: Session, fleet_id: UUID, chooser: VehicleFilter) -> dict[UUID, str]:
    """Id and name of the vehicles that ids and name pattern leave."""
    rows = session.execute(select(Vehicle.id, Vehicle.name).where(Vehicle.fleet_id == fleet_id))
    vehicles: dict[UUID, str] = {row.id: row.name for row in rows}
    if chooser.vehicle_ids is not None:
        strange = [str(id) for id in chooser.vehicle_ids if id not in vehicles]
        if strange:
            raise unprocessable(
                "unknown_vehicle",
                f"{len(strange)} of the {len(chooser.vehicle_ids)} vehicle ids are of no vehicle of this fleet; "
                f"the first is {strange[0]}.",
                "Give ids of GET /v1/fleets/{id}/vehicles.",
                vehicle_ids=strange[:100],
            )
        vehicles = {id: vehicles[id] for id in chooser.vehicle_ids}
    if chooser.name is not None:
        matches = _matcher(chooser.name)
        vehicles = {id: name for id, name in vehicles.items() if matches.fullmatch(name)}
    return vehicles


def _matcher(pattern: str) -> re.Pattern[str]:
    """The pattern, or the part of a name, as a regular expression. Here brackets mean themselves."""
    whole = pattern if re.search(r"[*?]", pattern) else f"*{pattern}*"
    return re.compile(translate(whole.replace("[", "[[]")), re.IGNORECASE)


def _with_rig(session: Session, fleet_id: UUID, pattern: str) -> set[UUID]:
    """The vehicles that have a rig of such a name."""
    matches = _matcher(pattern)
    rows = session.execute(select(Rig.vehicle_id, Rig.name).where(Rig.fleet_id == fleet_id))
    return {row.vehicle_id for row in rows if matches.fullmatch(row.name)}


def _newest_sets(session: Session, rigs: ColumnElement[bool], rig_pattern: str | None) -> dict[UUID, dict[str, UUID]]:
    """By vehicle, the newest set of each camera of the rig whose newest set is the newest."""
    once = (CorrespondenceSet.brought_at.is_(None), CorrespondenceSet.created_at)
    brought = (CorrespondenceSet.brought_at.is_not(None), CorrespondenceSet.brought_at)
    # Each camera's newest set of those made once, and of those imported again; there is an index for each.
    cameras = (
        select(
            *(Rig.vehicle_id, Rig.id.label("rig_id"), Rig.name.label("rig"), RigCamera.name.label("camera")),
            *(_newest_set(CorrespondenceSet.id, *once), _newest_set(once[1], *once)),
            *(_newest_set(CorrespondenceSet.id, *brought), _newest_set(brought[1], *brought)),
        )
        .join(RigCamera, RigCamera.rig_id == Rig.id)
        .where(rigs)
    )
    rows: list[_Newest] = []
    for vehicle_id, rig_id, rig, camera, *sets in session.execute(cameras):
        dated = [(at, set_id) for set_id, at in (sets[:2], sets[2:]) if set_id is not None]
        if dated:
            rows.append(_Newest(*max(dated), vehicle_id, rig_id, rig, camera))
    rows.sort()
    if rig_pattern is not None:
        matches = _matcher(rig_pattern)
        rows = [row for row in rows if matches.fullmatch(row.rig)]
    # Oldest first, so the last rig seen of a vehicle is the one with the newest set.
    rig_of = {row.vehicle_id: row.rig_id for row in rows}
    newest: dict[UUID, dict[str, UUID]] = defaultdict(dict)
    for row in rows:
        if rig_of[row.vehicle_id] == row.rig_id:
            newest[row.vehicle_id][row.camera] = row.set_id
    return newest


def _newest_set(
    column: InstrumentedAttribute[Any], which: ColumnElement[bool], by: InstrumentedAttribute[Any]
) -> ScalarSelect[Any]:
    """A column of the newest of such sets of the enclosing query's camera."""
    return (
        select(column)
        .where(CorrespondenceSet.rig_id == RigCamera.rig_id, CorrespondenceSet.camera == RigCamera.name, which)
        .order_by(by.desc(), CorrespondenceSet.id.desc())
        .limit(1)
        .correlate(RigCamera)
        .scalar_subquery()
    )


def _calibrated_since(session: Session, fleet_id: UUID, since: datetime) -> set[UUID]:
    done = exists().where(
        Calibration.vehicle_id == Vehicle.id,
        Calibration.state == state_literal(WorkState.DONE),
        Calibration.finished_at >= since,
    )
    return set(session.scalars(select(Vehicle.id).where(Vehicle.fleet_id == fleet_id, done)))


def _published_sets(session: Session, fleet_id: UUID) -> dict[tuple[UUID, str], UUID]:
    """By vehicle and camera, the set that was published last, withdrawn or not: a withdrawal makes no pairs new."""
    current = (
        select(CalibrationRun.set_id)
        .join(Result, Result.run_id == CalibrationRun.id)
        .join(Publication, Publication.result_id == Result.id)
        .where(
            Publication.vehicle_id == Rig.vehicle_id,
            Publication.camera == RigCamera.name,
            Publication.alias == CURRENT,
        )
        .order_by(Publication.number.desc())
        .limit(1)
        .correlate(Rig, RigCamera)
        .scalar_subquery()
    )
    cameras = select(Rig.vehicle_id, RigCamera.name, current).join(RigCamera, RigCamera.rig_id == Rig.id)
    rows = session.execute(cameras.where(Rig.fleet_id == fleet_id))
    return {(vehicle_id, camera): set_id for vehicle_id, camera, set_id in rows if set_id is not None}


def in_chunks(chosen: list[Chosen], size: int) -> Iterable[list[Chosen]]:
    """The vehicles a few at a time, so that not all their pairs are in memory at once."""
    return (chosen[first : first + size] for first in range(0, len(chosen), size))
