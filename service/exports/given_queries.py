"""What the cameras of a vehicle are given under an alias, now or at a moment; and why they are given nothing.

``current`` leads to the newest publication, or nowhere if that is withdrawn. Every other alias leads where its newest
move says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import Select, and_, select
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from service.calibration_runs.mounted_sensors import LIDAR, Calibrated, Swapped, swapped_sensors
from service.db.aliases import AliasMove, Withdrawal
from service.db.base import Json
from service.db.calibrations import NEWNESS, Calibration, CalibrationRun, CorrespondenceSet, Publication, Result
from service.db.detections import Detection
from service.db.fleets import Rig, RigCamera, Vehicle
from service.db.people import Person
from service.http.problems import Problem


class Asked(NamedTuple):
    """What is asked of a vehicle. No ``cameras``: all of them.

    ``mounted`` are serial numbers that the asker read off its sensors: by the camera's name, or ``lidar``.
    """

    cameras: Sequence[str] = ()
    alias: str = CURRENT
    as_of: datetime | None = None
    mounted: Mapping[str, str] = {}


class Given(NamedTuple):
    """What one camera is given, by which step, and what it was calibrated on."""

    move: Publication | AliasMove
    result: Result
    calibration: Calibration
    rig: Rig
    by: str | None
    pairing: Json | None
    camera_serial: str | None
    joint: Json | None = None
    frame: str = ""
    images: Json | None = None

    @property
    def camera(self) -> str:
        """The camera's name."""
        return self.move.camera

    @property
    def clock_offset_ns(self) -> int | None:
        """Its camera's clock minus the LiDAR's, as its pairs were made; None if that is not known."""
        return None if self.pairing is None else self.pairing.get("offset_ns", 0)


class _Withdrawn(NamedTuple):
    """A camera whose publication was withdrawn, or its alias removed. ``number``: of the last one withdrawn.

    ``deleted``: the result to which its alias led, if nobody removed the alias and the result was deleted.
    """

    camera: str
    number: int
    at: datetime
    by: str | None
    reason: str
    deleted: UUID | None = None

    def holds(self, publication: Publication) -> bool:
        """Whether no publication came after it. A publication without a number is newer than all that have one."""
        return publication.number is not None and publication.number <= self.number


def given(session: Session, vehicle: Vehicle, asked: Asked) -> dict[str, Given]:
    """What each camera is given, by name.

    Raises:
        Problem: 422 ``unknown_sensor``; 404 ``no_calibration_yet`` if an asked camera, or every camera, was never
            given anything; 410 ``calibration_withdrawn`` if it was withdrawn, ``calibration_deleted`` if its alias
            led to a result that was deleted; 409 ``calibration_does_not_apply`` if a sensor has been swapped since.
    """
    if asked.mounted:
        _check_sensors(session, vehicle, asked.mounted)
    found = {one.camera: one for one in (Given(*row) for row in session.execute(_rows(vehicle.id, asked)))}
    withdrawn = _withdrawn(session, vehicle.id, asked, found)
    if withdrawn and not asked.cameras:
        # Who asks for the vehicle is told of what it carries now.
        gone = {one.camera for one in withdrawn} - _mounted(session, vehicle.id, asked.as_of)
        withdrawn = [one for one in withdrawn if one.camera not in gone]
        found = {name: one for name, one in found.items() if name not in gone}
    if withdrawn:
        raise _refuse_withdrawn(vehicle, asked, withdrawn)
    missing = [name for name in asked.cameras if name not in found]
    if missing or not found:
        raise _refuse_missing(vehicle, asked, missing)
    calibrated = [Calibrated(one.camera, one.camera_serial, one.rig) for one in found.values()]
    swapped = swapped_sensors(session, vehicle.id, calibrated, asked.mounted, asked.as_of)
    if swapped:
        raise _refuse_swapped(vehicle, swapped)
    return found


def _rows(vehicle_id: UUID, asked: Asked) -> Select[*tuple[Any, ...]]:
    """All in one statement, because rows may be deleted between two. An index finds each camera's newest."""
    cameras = select(RigCamera.name).join(Rig, Rig.id == RigCamera.rig_id).where(Rig.vehicle_id == vehicle_id)
    if asked.cameras:
        cameras = cameras.where(RigCamera.name.in_(asked.cameras))
    names = cameras.distinct().subquery()
    move: Any = Publication if asked.alias == CURRENT else AliasMove
    of = [move.vehicle_id == vehicle_id, move.camera == names.c.name]
    if asked.as_of is not None:
        of.append(move.created_at <= asked.as_of)
    if move is AliasMove:
        of.append(AliasMove.alias == asked.alias)
    newness = (AliasMove.number,) if move is AliasMove else NEWNESS
    newest = select(move.id).where(*of).order_by(*(key.desc() for key in newness)).limit(1)
    # Joined, because for `IN` PostgreSQL would read the other tables whole.
    is_newest = move.id == newest.correlate(names).scalar_subquery()
    by = AliasMove.said_by if move is AliasMove else Publication.published_by
    return (
        select(move, Result, Calibration, Rig, Person.name, Detection.pairing)
        .add_columns(RigCamera.serial, RigCamera.joint, RigCamera.frame, RigCamera.images)
        .select_from(names)
        .join(move, is_newest)
        .outerjoin(Result, Result.id == move.result_id)
        .outerjoin(Calibration, Calibration.id == Result.calibration_id)
        .outerjoin(Rig, Rig.id == Calibration.rig_id)
        .outerjoin(RigCamera, and_(RigCamera.rig_id == Rig.id, RigCamera.name == move.camera))
        .outerjoin(CalibrationRun, CalibrationRun.id == Result.run_id)
        .outerjoin(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .outerjoin(Detection, Detection.id == CorrespondenceSet.detection_id)
        .outerjoin(Person, Person.id == by)
        .order_by(move.camera)
    )


def withdrawals(*where: Any) -> Select[Withdrawal, str]:
    """A query for withdrawals with the names of who withdrew."""
    return select(Withdrawal, Person.name).outerjoin(Person, Person.id == Withdrawal.said_by).where(*where)


def _withdrawn(session: Session, vehicle_id: UUID, asked: Asked, found: Mapping[str, Given]) -> list[_Withdrawn]:
    """The cameras whose publication was withdrawn, or alias removed, and not replaced, by name."""
    if asked.alias != CURRENT:
        return [
            _Withdrawn(one.camera, 0, one.move.created_at, one.by, one.move.reason or "", one.move.led_to)
            for one in found.values()
            if isinstance(one.move, AliasMove) and one.move.result_id is None
        ]
    of = [Withdrawal.vehicle_id == vehicle_id]
    if asked.cameras:
        of.append(Withdrawal.camera.in_(asked.cameras))
    if asked.as_of is not None:
        of.append(Withdrawal.created_at <= asked.as_of)
    rows = session.execute(withdrawals(*of).order_by(Withdrawal.camera, Withdrawal.number))
    last = {row.camera: _Withdrawn(row.camera, row.number, row.created_at, by, row.reason) for row, by in rows}
    moves = {name: one.move for name, one in found.items()}
    return [
        one for name, one in last.items() if not isinstance(move := moves.get(name), Publication) or one.holds(move)
    ]


def _mounted(session: Session, vehicle_id: UUID, as_of: datetime | None) -> set[str]:
    """The cameras of the newest rig of each LiDAR."""
    rigs = select(Rig.id, Rig.lidar_frame).where(Rig.vehicle_id == vehicle_id)
    if as_of is not None:
        rigs = rigs.where(Rig.created_at <= as_of)
    newest = {frame: id for id, frame in session.execute(rigs.order_by(Rig.created_at, Rig.id))}
    return set(session.scalars(select(RigCamera.name).where(RigCamera.rig_id.in_(newest.values()))))


def _check_sensors(session: Session, vehicle: Vehicle, mounted: Mapping[str, str]) -> None:
    rigs = select(RigCamera.name).join(Rig, Rig.id == RigCamera.rig_id).where(Rig.vehicle_id == vehicle.id)
    known = {LIDAR, *session.scalars(rigs)}
    strange = sorted(set(mounted) - known)
    if strange:
        raise Problem(
            422,
            "unknown_sensor",
            f"{vehicle.name!r} has no sensor {strange[0]!r}.",
            f"Its sensors are {', '.join(sorted(known))}.",
        )


def _refuse_missing(vehicle: Vehicle, asked: Asked, missing: Sequence[str]) -> Problem:
    which = f"the camera {missing[0]!r}" if missing else "any camera"
    when = f" until {asked.as_of.isoformat()}" if asked.as_of else ""
    if asked.alias != CURRENT:
        return Problem(
            404,
            "no_calibration_yet",
            f"The alias {asked.alias!r} led nowhere for {which} of {vehicle.name!r}{when}.",
            "Move it: POST /v1/vehicles/{id}/cameras/{camera}/aliases/{alias}/moves, or ask for `current`.",
        )
    return Problem(
        404,
        "no_calibration_yet",
        f"Nothing has been published for {which} of {vehicle.name!r}{when}.",
        "Publish a result: POST /v1/results/{id}/publication, or ask for a calibration with "
        '"publish": "recommended".',
    )


def _refuse_withdrawn(vehicle: Vehicle, asked: Asked, withdrawn: Sequence[_Withdrawn]) -> Problem:
    deleted = [one for one in withdrawn if one.deleted]
    if deleted:
        return _refuse_deleted(vehicle, asked, deleted)
    first = withdrawn[0]
    more = f" ({len(withdrawn) - 1} more in `withdrawn`)" if len(withdrawn) > 1 else ""
    by = f" by {first.by}" if first.by else ""
    what = "calibration" if asked.alias == CURRENT else f"alias {asked.alias!r}"
    return Problem(
        410,
        "calibration_withdrawn",
        f"The {what} of the camera {first.camera!r} of {vehicle.name!r} was withdrawn{by}, "
        f"{first.at:%Y-%m-%d %H:%M} UTC: {first.reason}{more}",
        "Publish a result for it, or an older one again. `camera` narrows the answer to the others.",
        withdrawn=[
            {"camera": one.camera, "withdrawn_at": one.at.isoformat(), "withdrawn_by": one.by, "reason": one.reason}
            for one in withdrawn
        ],
    )


def _refuse_deleted(vehicle: Vehicle, asked: Asked, deleted: Sequence[_Withdrawn]) -> Problem:
    first = deleted[0]
    return Problem(
        410,
        "calibration_deleted",
        f"The alias {asked.alias!r} of the camera {first.camera!r} of {vehicle.name!r} was moved to a result at "
        f"{first.at:%Y-%m-%d %H:%M} UTC. That result was deleted.",
        "Move the alias to another result: POST /v1/vehicles/{id}/cameras/{camera}/aliases/{alias}/moves.",
        deleted=[
            {"camera": one.camera, "result_id": str(one.deleted), "moved_at": one.at.isoformat()} for one in deleted
        ],
    )


def _refuse_swapped(vehicle: Vehicle, swapped: Sequence[Swapped]) -> Problem:
    more = f" ({len(swapped) - 1} more in `swapped`)" if len(swapped) > 1 else ""
    return Problem(
        409,
        "calibration_does_not_apply",
        f"The calibration of {vehicle.name!r} does not apply. {swapped[0].sentence}{more}",
        "Calibrate with the mounted sensors and publish that. `camera` narrows the answer to the others. If a serial "
        "number was mistyped, correct it: PATCH /v1/rigs/{id}/serials.",
        swapped=[one._asdict() for one in swapped],
    )
