"""What a vehicle's cars are answered, a sentence for each question that they may ask."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import groupby
from typing import Any
from uuid import UUID

from sqlalchemy import and_, select
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from service.platform.db.calibrations import Calibration, Publication, Result
from service.platform.db.fleets import Rig, RigCamera, Vehicle
from service.publications.mounted_sensors import (
    CalibratedSensor,
    cameras_of,
    carries,
    mounted_cameras,
    mounted_serials,
    swapped_sensors,
)
from service.publications.queries import is_newest

_WITHDRAWN, _DELETED = "nothing, it was withdrawn (410)", "nothing, it was deleted (410)"
_SWAPPED = "nothing, a sensor was swapped (409)"


def car_answers(session: Session, vehicle_id: UUID) -> tuple[str, dict[str, str]]:
    """The vehicle's name, and by question the answer: for each camera and all of them, the name, each serial number.

    A question that is not there is answered 404. Without publications there is none but for a serial number that
    two vehicles of the fleet carry.
    """
    vehicle = session.get(Vehicle, vehicle_id)
    if vehicle is None:
        return "", {}
    answers: dict[str, str] = {}
    for alias, moves in groupby(_moves(session, vehicle_id), lambda move: move[0].alias):
        whose = "" if alias == CURRENT else f" as {alias}"
        answers |= {f"{what}{whose}": answer for what, answer in _of_alias(session, vehicle_id, list(moves)).items()}
    if answers:
        answers["by its name"] = vehicle.name
    for serial in mounted_serials(session, vehicle_id):
        if _is_elsewhere(session, vehicle, serial):
            answers[f"by the sensor {serial}"] = "nothing, several vehicles have it (409)"
        elif answers:
            answers[f"by the sensor {serial}"] = "this vehicle"
    return vehicle.name, answers


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


def _is_elsewhere(session: Session, vehicle: Vehicle, serial: str) -> bool:
    """Whether another vehicle of the fleet carries a sensor with this serial number too."""
    others = select(Rig.vehicle_id).where(Rig.fleet_id == vehicle.fleet_id, Rig.vehicle_id != vehicle.id)
    # Each by its own index: a fleet has thousands of rigs.
    of_lidars = others.where(Rig.lidar_serial == serial)
    of_cameras = others.join(RigCamera, RigCamera.rig_id == Rig.id).where(RigCamera.serial == serial)
    return any(carries(session, other, serial) for other in session.scalars(of_lidars.union(of_cameras)))
