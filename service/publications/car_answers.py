"""The answers to cars, a sentence for each question that they may ask, and the changes of these."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence, Set
from itertools import groupby
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy import and_, select
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from service.platform.db.calibrations import Calibration, Publication, Result
from service.platform.db.fleets import Fleet, Rig, RigCamera, RigLidar, Vehicle
from service.publications.mounted_sensors import (
    CalibratedSensor,
    cameras_of,
    mounted_cameras,
    mounted_serials,
    swapped_sensors,
)
from service.publications.queries import is_newest

_NOTHING, _SEVERAL = "nothing", "nothing, several vehicles have it (409)"
_WITHDRAWN, _DELETED = "nothing, it was withdrawn (410)", "nothing, it was deleted (410)"
_SWAPPED = "nothing, a sensor was swapped (409)"


class CarAnswers(NamedTuple):
    """A vehicle, what its cars are answered by question, and the serial numbers of the sensors that it carries.

    A question that is not there is answered 404; without publications there is none.
    """

    name: str = ""
    fleet_id: UUID | None = None
    answers: Mapping[str, str] = {}
    serials: Set[str] = frozenset()


def car_answers(session: Session, vehicle_id: UUID) -> CarAnswers:
    """The answers for each camera, for all of them, and by the vehicle's name; empty where the vehicle is gone."""
    vehicle = session.get(Vehicle, vehicle_id)
    if vehicle is None:
        return CarAnswers()
    answers: dict[str, str] = {}
    for alias, moves in groupby(_moves(session, vehicle_id), lambda move: move[0].alias):
        whose = "" if alias == CURRENT else f" as {alias}"
        answers |= {f"{what}{whose}": answer for what, answer in _of_alias(session, vehicle_id, list(moves)).items()}
    if answers:
        answers["by its name"] = vehicle.name
    return CarAnswers(vehicle.name, vehicle.fleet_id, answers, {*mounted_serials(session, vehicle_id)})


def changed_answers(session: Session, before: Mapping[UUID, CarAnswers], fleets: Mapping[UUID, str]) -> list[str]:
    """Return a sentence for each answer that differs from ``before``. ``fleets``: the renamed ones' names before."""
    after = {vehicle_id: car_answers(session, vehicle_id) for vehicle_id in before}
    lines: list[str] = []
    serials: set[tuple[str, UUID | None]] = set()
    for old, new in zip(before.values(), after.values(), strict=True):
        lines += [
            f"{old.name or new.name}, {question}: {was} -> {is_now}"
            for question in {**old.answers, **new.answers}
            if (was := old.answers.get(question, _NOTHING)) != (is_now := new.answers.get(question, _NOTHING))
        ]
        both = old.serials ^ new.serials if bool(old.answers) == bool(new.answers) else old.serials | new.serials
        serials |= {(serial, new.fleet_id or old.fleet_id) for serial in both}
    for serial, fleet_id in sorted(serials, key=str):
        others = {id: car_answers(session, id) for id in _carriers(session, fleet_id, serial) if id not in before}
        was, is_now = (_of_sensor(serial, {**others, **vehicles}.values()) for vehicles in (before, after))
        if was != is_now:
            lines.append(f"by the sensor {serial}: {was} -> {is_now}")
    for fleet_id, name in fleets.items():
        fleet = session.get(Fleet, fleet_id)
        any_move = select(Publication.id).where(Publication.fleet_id == fleet_id).limit(1)
        if fleet is not None and fleet.name != name and session.scalar(any_move) is not None:
            lines.append(f"by the fleet's name: {name} -> {fleet.name}")
    return lines


def _of_sensor(serial: str, vehicles: Iterable[CarAnswers]) -> str:
    names = [vehicle.name if vehicle.answers else _NOTHING for vehicle in vehicles if serial in vehicle.serials]
    return _SEVERAL if len(names) > 1 else (names or [_NOTHING])[0]


def _moves(session: Session, vehicle_id: UUID) -> Sequence[Any]:
    """The last move of each alias of each camera that a rig has, with the rig and mount that were calibrated."""
    statement = (
        select(Publication, Rig, RigCamera)
        .outerjoin(Result, Result.id == Publication.result_id)
        .outerjoin(Calibration, Calibration.id == Result.calibration_id)
        .outerjoin(Rig, Rig.id == Calibration.rig_id)
        .outerjoin(RigCamera, and_(RigCamera.rig_id == Rig.id, RigCamera.name == Publication.camera))
        .where(Publication.vehicle_id == vehicle_id, is_newest())
        .order_by(Publication.alias, Publication.camera)
    )
    cameras = cameras_of(session, vehicle_id)
    return [row for row in session.execute(statement).all() if row[0].camera in cameras]


def _of_alias(session: Session, vehicle_id: UUID, moves: Sequence[Any]) -> dict[str, str]:
    calibrated = [CalibratedSensor(move.camera, mount.serial, rig) for move, rig, mount in moves if mount is not None]
    swapped = {sensor.camera for sensor in swapped_sensors(session, vehicle_id, calibrated)}
    cameras: dict[str, str] = {}
    for move, _, mount in moves:
        images = f" for images {json.dumps(mount.images, sort_keys=True)}" if mount and mount.images else ""
        answer = _SWAPPED if move.camera in swapped else f"result {move.result_id}{images}"
        if move.result_id is None:
            answer = _DELETED if move.led_to else _WITHDRAWN
        cameras[move.camera] = answer
    carried = mounted_cameras(session, vehicle_id)
    nowhere = [answer for name, answer in cameras.items() if answer in (_WITHDRAWN, _DELETED) and name in carried]
    refusals = [*nowhere, *([_SWAPPED] if swapped else [])]
    led = [name for name, answer in cameras.items() if answer not in (_WITHDRAWN, _DELETED)]
    every = {"all cameras": refusals[0] if refusals else ", ".join(led)} if refusals or led else {}
    return {**cameras, **every}


def _carriers(session: Session, fleet_id: UUID | None, serial: str) -> Sequence[UUID]:
    """The vehicles of the fleet that carry or carried a sensor with this serial number."""
    rigs = select(Rig.vehicle_id).where(Rig.fleet_id == fleet_id)
    # Each by its own index: a fleet has thousands of rigs.
    of_lidars = rigs.join(RigLidar, RigLidar.rig_id == Rig.id).where(RigLidar.serial == serial)
    return session.scalars(
        of_lidars.union(rigs.join(RigCamera, RigCamera.rig_id == Rig.id).where(RigCamera.serial == serial))
    ).all()
