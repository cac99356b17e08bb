"""The serial numbers of a vehicle's sensors now, and whether a result was made with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import NamedTuple
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.fleets import Rig, RigCamera, RigLidar

LIDAR = "lidar"


class CalibratedSensor(NamedTuple):
    """A camera of a rig that something was calibrated on."""

    camera: str
    serial: str | None
    rig: Rig


class Swapped(NamedTuple):
    """A sensor whose serial number differs from the calibrated one. ``rig`` states it; None: the asker does."""

    camera: str
    sensor: str
    calibrated: str
    mounted: str
    rig: str | None

    @property
    def sentence(self) -> str:
        """Say which sensors were swapped."""
        what = f"camera {self.camera}" if self.sensor == self.camera else f"LiDAR of {self.camera}"
        by = f"the rig {self.rig!r}" if self.rig else "the vehicle"
        return f"It is of the {what} with the serial number {self.calibrated}; {by} now says {self.mounted}."


def swapped_sensors(
    session: Session,
    vehicle_id: UUID,
    calibrated: Sequence[CalibratedSensor],
    read_off: Mapping[str, str] | None = None,
    as_of: datetime | None = None,
) -> list[Swapped]:
    """Return the sensors that differ from the calibrated ones.

    ``read_off`` holds serial numbers that the asker read off its sensors, by the camera's name or ``lidar``. For
    others the vehicle's newest rig that states one counts. If either side states none, the sensor counts as not
    swapped.
    """
    cameras, lidars = _mounted(session, vehicle_id, as_of)
    swapped: list[Swapped] = []
    for calibration in calibrated:
        lidar = calibration.rig.lidar
        for sensor, calibrated_serial, stated in (
            (calibration.camera, calibration.serial, cameras.get(calibration.camera)),
            (LIDAR, lidar.serial, lidars.get(lidar.frame)),
        ):
            reading = (read_off or {}).get(sensor)
            now, rig = (reading, None) if reading is not None else (stated or (None, None))
            if calibrated_serial is not None and now is not None and calibrated_serial != now:
                swapped.append(Swapped(calibration.camera, sensor, calibrated_serial, now, rig))
    return swapped


def carries(session: Session, vehicle_id: UUID, serial: str) -> bool:
    """Whether the vehicle carries a sensor with this serial number now, and not only once."""
    return serial in mounted_serials(session, vehicle_id)


def mounted_serials(session: Session, vehicle_id: UUID) -> list[str]:
    """The serial numbers of the sensors that the vehicle carries now."""
    return sorted({serial for stated in _mounted(session, vehicle_id, None) for serial, _ in stated.values()})


def cameras_of(session: Session, vehicle_id: UUID) -> set[str]:
    """The names of the cameras of all its rigs."""
    names = select(RigCamera.name).join(Rig, Rig.id == RigCamera.rig_id).where(Rig.vehicle_id == vehicle_id)
    return set(session.scalars(names))


def mounted_cameras(session: Session, vehicle_id: UUID, as_of: datetime | None = None) -> set[str]:
    """The cameras of the newest rig of each LiDAR."""
    rigs = (
        select(Rig.id, RigLidar.frame).join(RigLidar, RigLidar.rig_id == Rig.id).where(Rig.vehicle_id == vehicle_id)
    )
    if as_of is not None:
        rigs = rigs.where(Rig.created_at <= as_of)
    newest = {frame: id for id, frame in session.execute(rigs.order_by(Rig.created_at, Rig.id))}
    return set(session.scalars(select(RigCamera.name).where(RigCamera.rig_id.in_(newest.values()))))


_Stated = dict[str, tuple[str, str]]


def _mounted(session: Session, vehicle_id: UUID, as_of: datetime | None) -> tuple[_Stated, _Stated]:
    """Serial numbers by camera and by the LiDAR's frame, each with the name of the newest rig that states it."""
    rigs = [Rig.vehicle_id == vehicle_id]
    if as_of is not None:
        rigs.append(Rig.created_at <= as_of)
    rows = session.execute(
        select(Rig.name, RigLidar.frame, RigLidar.serial, RigCamera.name, RigCamera.serial)
        .join(RigLidar, RigLidar.rig_id == Rig.id)
        .join(RigCamera, RigCamera.rig_id == Rig.id)
        .where(*rigs)
        .order_by(Rig.created_at, Rig.id)
    )
    cameras: _Stated = {}
    lidars: _Stated = {}
    for rig, frame, lidar_serial, camera, serial in rows:
        if lidar_serial is not None:
            lidars[frame] = (lidar_serial, rig)
        if serial is not None:
            cameras[camera] = (serial, rig)
    return cameras, lidars
