"""The calibrations of a vehicle's cameras under an alias, now or at a moment; or why there are none."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import UUID

from sqlalchemy import Select, and_, func, select
from sqlalchemy.orm import Session

from service.exports.queries import of_results
from service.platform.db.base import Json
from service.platform.db.calibrations import (
    Calibration,
    CalibrationRun,
    CorrespondenceSet,
    Publication,
    Result,
    newest_move,
)
from service.platform.db.detections import Detection
from service.platform.db.fleets import Rig, RigCamera, Vehicle
from service.platform.db.people import Person
from service.platform.http.problems import conflict
from service.publications.camera_rules import check_sensors, refuse_missing, refuse_nothing, refuse_swapped
from service.publications.mounted_sensors import CalibratedSensor, mounted_cameras, swapped_sensors
from service.publications.selection import Selection

if TYPE_CHECKING:
    from service.exports.calibrated import Calibrated


class PublishedCamera(NamedTuple):
    """One camera's published result, its publication, and the rig that it was calibrated on."""

    publication: Publication
    result: Result
    calibration: Calibration
    rig: Rig
    mount: RigCamera
    published_by: str | None
    pairing: Json | None

    @property
    def camera(self) -> str:
        """The camera's name."""
        return self.publication.camera

    @property
    def clock_offset_ns(self) -> int | None:
        """Its camera's clock minus the LiDAR's, as its pairs were made; None if that is not known."""
        return None if self.pairing is None else self.pairing.get("offset_ns", 0)


def published_cameras(session: Session, vehicle: Vehicle, selection: Selection) -> dict[str, PublishedCamera]:
    """Return each camera's published calibration, by name.

    Raises:
        Problem: 422 ``unknown_sensor``; 404 ``no_calibration_yet`` if a selected camera, or every camera, was never
            given anything; 410 ``calibration_withdrawn`` if it was withdrawn, ``calibration_deleted`` if its result
            was deleted; 409 ``calibration_does_not_apply`` if a sensor has been swapped since.
    """
    if selection.mounted:
        check_sensors(session, vehicle, selection.mounted)
    newest = [PublishedCamera(*row) for row in session.execute(_newest(vehicle.id, selection))]
    if not selection.cameras and any(row.publication.result_id is None for row in newest):
        # A request for the vehicle is answered by what it carries now.
        mounted = mounted_cameras(session, vehicle.id, selection.as_of)
        newest = [row for row in newest if row.publication.result_id is not None or row.camera in mounted]
    led_nowhere = [(row.publication, row.published_by) for row in newest if row.publication.result_id is None]
    if led_nowhere:
        raise refuse_nothing(vehicle, selection, led_nowhere)
    published = {row.camera: row for row in newest}
    missing = [name for name in selection.cameras if name not in published]
    if missing or not published:
        raise refuse_missing(vehicle, selection, missing)
    calibrated = [CalibratedSensor(row.camera, row.mount.serial, row.rig) for row in newest]
    swapped = swapped_sensors(session, vehicle.id, calibrated, selection.mounted, selection.as_of)
    if swapped:
        raise refuse_swapped(vehicle, swapped)
    return published


def published_exports(session: Session, vehicle: Vehicle, selection: Selection) -> Calibrated:
    """Return the calibration as exports read it. Raises :class:`Problem`, also 409 ``conflict``."""
    results = [row.result.id for row in published_cameras(session, vehicle, selection).values()]
    calibrated = of_results(session, results)
    if len(calibrated.cameras) < len(results):
        raise conflict("conflict", "One of the calibrations was deleted at this moment.", "Ask again.")
    return calibrated


def next_moves(session: Session, vehicle_id: UUID, alias: str, as_of: datetime) -> dict[str, datetime]:
    """Return, by camera, when its alias first moved after a moment."""
    later = (Publication.vehicle_id == vehicle_id, Publication.alias == alias, Publication.created_at > as_of)
    first = func.min(Publication.created_at)
    rows = session.execute(select(Publication.camera, first).where(*later).group_by(Publication.camera))
    return {row[0]: row[1] for row in rows}


def _newest(vehicle_id: UUID, selection: Selection) -> Select[*tuple[Any, ...]]:
    """Read each camera's newest move by an index, in one statement, because rows may be deleted between two."""
    cameras = select(RigCamera.name).join(Rig, Rig.id == RigCamera.rig_id).where(Rig.vehicle_id == vehicle_id)
    if selection.cameras:
        cameras = cameras.where(RigCamera.name.in_(selection.cameras))
    names = cameras.distinct().subquery()
    newest = newest_move(vehicle_id, names.c.name, selection.alias, selection.as_of)
    return (
        select(Publication, Result, Calibration, Rig, RigCamera, Person.name, Detection.pairing)
        .select_from(names)
        # Joined, because for `IN` PostgreSQL would read the other tables whole.
        .join(Publication, Publication.id == newest.correlate(names).scalar_subquery())
        .outerjoin(Result, Result.id == Publication.result_id)
        .outerjoin(Calibration, Calibration.id == Result.calibration_id)
        .outerjoin(Rig, Rig.id == Calibration.rig_id)
        .outerjoin(RigCamera, and_(RigCamera.rig_id == Rig.id, RigCamera.name == Publication.camera))
        .outerjoin(CalibrationRun, CalibrationRun.id == Result.run_id)
        .outerjoin(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .outerjoin(Detection, Detection.id == CorrespondenceSet.detection_id)
        .outerjoin(Person, Person.id == Publication.published_by)
        .order_by(Publication.camera)
    )
