"""Deleting with all that came from it, in one transaction: a recording, a detection, calibrations, a rig, a vehicle.

The sweep removes the bytes afterwards. What was published stays, unless its loss is asked for with the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from uuid import UUID

from sqlalchemy import ColumnElement, CompoundSelect, Select, delete, false, or_, select, true
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from apexcal.documents.states import VehicleState, WorkState
from service.calibration_runs.actions import end_calibrations
from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from service.platform.db.detections import Detection
from service.platform.db.fleet_requests import FleetRequestVehicle
from service.platform.db.fleets import Rig, Vehicle
from service.platform.db.recordings import LAYERS, Blob, Recording, Sensor, UploadPart
from service.platform.db.session import put
from service.platform.http.problems import Problem, conflict, not_found
from service.platform.jobs.queue import abandon
from service.platform.storage.blobs import condemn, sensor_keys
from service.platform.storage.errors import EXPIRED
from service.platform.storage.quota import counted, recounting
from service.publications.actions import hold_publications
from service.publications.queries import aliases_to

_DELETED: Json = {
    "code": "recording_deleted",
    "detail": "The recording that this vehicle's pairs came from was deleted meanwhile.",
    "hint": "Ask again when the vehicle has other pairs.",
}

_NONE = false()


@dataclass(frozen=True)
class _Origin:
    """A thing that is deleted, with the queries for what came from it. ``kind`` names it in sentences.

    ``sets``: its correspondence sets; the calibrations that used one of them go, and ``calibrations`` too.
    ``analyses``: those that are its own. ``subjects``: jobs of its own work for these.
    """

    kind: str
    vehicle_id: UUID | None
    sets: ColumnElement[bool] = _NONE
    calibrations: ColumnElement[bool] = _NONE
    analyses: ColumnElement[bool] = _NONE
    subjects: Select[UUID] | CompoundSelect[UUID] | None = None


def delete_recording(
    session: Session, recording_id: UUID, *, with_published: bool, which: ColumnElement[bool] | None = None
) -> None:
    """Delete a recording, its marks, detections, correspondence sets and every calibration that used them.

    Raises :class:`Problem` 409 ``calibration_in_use`` where one of these calibrations is a vehicle's current one
    or an alias leads to it, unless ``with_published``; 404 where it is none of ``which`` once it is locked.
    """
    recording = select(Recording.id).where(Recording.id == recording_id)
    origin = _Origin(
        "recording",
        session.scalar(select(Recording.vehicle_id).where(Recording.id == recording_id)),
        sets=CorrespondenceSet.recording_id == recording_id,
        analyses=Analysis.recording_id == recording_id,
        subjects=recording.union_all(select(Detection.id).where(Detection.recording_id == recording_id)),
    )
    # Jobs first, as workers lock them before the rows that they work for; then again, for one made meanwhile.
    abandon(session, _subjects(session, origin))
    own = recording.where(true() if which is None else which).with_for_update()
    if session.scalar(own) is None and which is not None:
        raise not_found()
    _delete_descent(session, origin, with_published=with_published)
    parts = session.scalars(select(UploadPart.blob_key).where(UploadPart.recording_id == recording_id))
    condemn(session, [*parts, *sensor_keys(session, recording_id)])
    session.execute(delete(Recording).where(Recording.id == recording_id))


def remove_layers(session: Session, row: Recording, count: int) -> None:
    """Remove the first ``count`` of `LAYERS` of a locked recording. Its rows, pairs and results stay.

    The images' layer takes calibrated copies and pictures of crops with it.
    """
    if count > row.layers_gone and not session.get(Blob, EXPIRED):
        put(session, Blob, {"key": EXPIRED}, first={"state": EXPIRED})
    for layer in LAYERS[row.layers_gone : count]:
        if layer == "original":
            of_upload = UploadPart.recording_id == row.id
            condemn(session, session.scalars(select(UploadPart.blob_key).where(of_upload)).all())
            session.execute(delete(UploadPart).where(of_upload))
            continue
        sensors = session.scalars(
            select(Sensor).where(
                Sensor.recording_id == row.id, Sensor.kind == ("camera" if layer == "images" else "lidar")
            )
        ).all()
        of_analyses = AnalysisFile.analysis_id.in_(select(Analysis.id).where(Analysis.recording_id == row.id))
        keys = [sensor.blob_key for sensor in sensors]
        keys += session.scalars(select(AnalysisFile.blob_key).where(of_analyses)).all()
        session.execute(delete(AnalysisFile).where(of_analyses))
        condemn(session, keys)
        for sensor in sensors:
            sensor.blob_key = EXPIRED
    row.layers_gone = count
    row.warnings = [*row.warnings, f"Removed at the end of its retention: {', '.join(LAYERS[:count])}."]
    session.flush()
    row.taken_bytes = counted(session, row, besides=None)
    row.version += 1


def delete_detection(session: Session, detection: Detection, vehicle_id: UUID) -> None:
    """Delete a detection with its vertices, sets and calibrations. Marks stay with the recording's corners.

    Raises :class:`Problem` 409 ``calibration_in_use``.
    """
    id_ = detection.id
    of_sets, own = CorrespondenceSet.detection_id == id_, select(Detection.id).where(Detection.id == id_)
    origin = _Origin("detection", vehicle_id, of_sets, analyses=Analysis.detection_id == id_, subjects=own)
    abandon(session, _subjects(session, origin))
    # The tiles around the machine's marks counted to the recording.
    with recounting(session, detection.recording_id, besides=None):
        _delete_descent(session, origin)
        session.execute(delete(Detection).where(Detection.id == id_))


def delete_set(session: Session, row: CorrespondenceSet, is_due: Callable[[], bool]) -> bool:
    """Delete a correspondence set with its selections and calibrations; whether it was due still once it was locked.

    Raises :class:`Problem` 409 ``calibration_in_use``.
    """
    own = or_(CorrespondenceSet.id == row.id, CorrespondenceSet.whole_id == row.id)
    is_deleted = _delete_descent(session, _Origin("set of pairs", row.vehicle_id, own), is_due=is_due)
    if is_deleted:
        session.execute(delete(CorrespondenceSet).where(CorrespondenceSet.id == row.id))
    return is_deleted


def delete_calibration(session: Session, calibration: Calibration) -> None:
    """Delete a calibration with its results. Raises :class:`Problem` 409 ``calibration_in_use``."""
    origin = _Origin("calibration", calibration.vehicle_id, calibrations=Calibration.id == calibration.id)
    abandon(session, _subjects(session, origin))
    _delete_descent(session, origin)


def delete_rig(session: Session, rig: Rig) -> None:
    """Delete a rig with its imported pairs and their calibrations.

    Raises :class:`Problem` 409 ``rig_in_use`` where a recording was read with it, ``calibration_in_use``.
    """
    name = session.scalar(select(Recording.name).where(Recording.rig_id == rig.id).limit(1))
    if name is not None:
        raise conflict(
            "rig_in_use",
            f"The recording {name!r} belongs to the rig {rig.name!r}.",
            "Give the recording another rig, or delete it first.",
        )
    own, of_sets = Calibration.rig_id == rig.id, CorrespondenceSet.rig_id == rig.id
    origin = _Origin("rig", rig.vehicle_id, of_sets, own)
    abandon(session, _subjects(session, origin))
    _delete_descent(session, origin)
    session.execute(delete(Rig).where(Rig.id == rig.id))


def delete_vehicle(session: Session, vehicle: Vehicle) -> None:
    """Delete a vehicle with its rigs, recordings and calibrations.

    Raises :class:`Problem` 409 ``calibration_in_use`` where anything of it is published, ``fleet_request_running``.
    """
    id_ = vehicle.id
    waiting = (FleetRequestVehicle.vehicle_id == id_, FleetRequestVehicle.state == VehicleState.QUEUED)
    if session.scalar(select(FleetRequestVehicle.id).where(*waiting).limit(1)) is not None:
        raise conflict(
            "fleet_request_running",
            f"A fleet request calibrates the vehicle {vehicle.name!r}.",
            "Wait until it ends, or cancel it.",
        )
    for recording_id in session.scalars(select(Recording.id).where(Recording.vehicle_id == id_)).all():
        delete_recording(session, recording_id, with_published=False)
    own, of_sets = Calibration.vehicle_id == id_, CorrespondenceSet.vehicle_id == id_
    origin = _Origin("vehicle", id_, of_sets, own, Analysis.vehicle_id == id_)
    abandon(session, _subjects(session, origin))
    _delete_descent(session, origin)
    session.execute(delete(Vehicle).where(Vehicle.id == id_))


def _delete_descent(
    session: Session, origin: _Origin, *, with_published: bool = False, is_due: Callable[[], bool] = lambda: True
) -> bool:
    """Delete the calibrations that come from the origin, and condemn the files of all its analyses.

    Nothing, and it returns False, where it is not due any more once its sets are locked.
    """
    # A retry of a fleet request holds its failed vehicles, then the sets.
    failed = select(FleetRequestVehicle.id).where(
        FleetRequestVehicle.calibration_id.in_(_calibrations(session, origin)),
        FleetRequestVehicle.state == VehicleState.FAILED,
    )
    session.execute(failed.order_by(FleetRequestVehicle.id).with_for_update(key_share=True)).all()
    # A calibration being asked for holds its sets, not what they come from: wait for it, so that its runs are seen.
    session.execute(select(CorrespondenceSet.id).where(origin.sets).with_for_update()).all()
    if not is_due():
        return False
    abandon(session, _subjects(session, origin))
    calibrations = _calibrations(session, origin)
    # In one order: two recordings of one vehicle share calibrations, and may be deleted at the same moment.
    shared = select(Calibration.id).where(Calibration.id.in_(calibrations)).order_by(Calibration.id)
    session.execute(shared.with_for_update()).all()
    # After the calibrations, in the same order as publishing.
    if origin.vehicle_id is not None:
        hold_publications(session, origin.vehicle_id)
        if not with_published:
            _refuse_in_use(session, origin.kind, origin.vehicle_id, calibrations)
    files = select(AnalysisFile.blob_key).join(Analysis, Analysis.id == AnalysisFile.analysis_id)
    condemn(session, session.scalars(files.where(_goes_with(origin, calibrations))).all())
    end_calibrations(session, calibrations, WorkState.CANCELLED, _DELETED)
    session.execute(delete(Calibration).where(Calibration.id.in_(calibrations)))
    return True


def _calibrations(session: Session, origin: _Origin) -> Sequence[UUID]:
    used = select(CalibrationRun.calibration_id).join(
        CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id
    )
    of_sets = session.scalars(used.where(origin.sets).distinct()).all()
    return list({*of_sets, *session.scalars(select(Calibration.id).where(origin.calibrations))})


def _goes_with(origin: _Origin, calibrations: Sequence[UUID]) -> ColumnElement[bool]:
    """Whether an analysis is the origin's own, of its pairs, or of a result of these calibrations."""
    sets = select(CorrespondenceSet.id).where(origin.sets)
    results = select(Result.id).where(Result.calibration_id.in_(calibrations))
    return or_(origin.analyses, Analysis.set_id.in_(sets), Analysis.result_id.in_(results))


def _subjects(session: Session, origin: _Origin) -> list[UUID]:
    calibrations = _calibrations(session, origin)
    runs = select(CalibrationRun.id).where(CalibrationRun.calibration_id.in_(calibrations))
    return [
        *(session.scalars(origin.subjects) if origin.subjects is not None else ()),
        *session.scalars(select(Analysis.id).where(_goes_with(origin, calibrations))),
        *calibrations,
        *session.scalars(runs),
    ]


def _refuse_in_use(session: Session, kind: str, vehicle_id: UUID, calibrations: Sequence[UUID]) -> None:
    used = [
        f"{'current calibration' if alias == CURRENT else f'alias {alias}'} of {camera}"
        for alias, camera in aliases_to(session, vehicle_id, calibrations)
    ]
    if used:
        with_it = ", or delete with ?with_published=true and lose that one too" if kind == "recording" else ""
        raise conflict(
            "calibration_in_use",
            f"The vehicle's {' and '.join(used)} came from this {kind}.",
            f"Publish another calibration first, or withdraw this one{with_it}.",
        )


def require_same_sensors(session: Session, recording: Recording, rig: Rig) -> None:
    """Raise :class:`Problem` 409 ``sensors_differ`` unless the recording was read as this rig would have it read."""
    rows = {row.name: row for row in session.scalars(select(Sensor).where(Sensor.recording_id == recording.id))}
    topics = {lidar.name: lidar.topic for lidar in rig.lidars} | {camera.name: camera.topic for camera in rig.cameras}
    sizes = {camera.name: (camera.image_width, camera.image_height) for camera in rig.cameras}
    for name, topic in topics.items():
        row = rows.get(name)
        if row is None:
            raise _differ(f"The recording has no {name!r}: its sensors are {', '.join(sorted(rows))}.")
        if topic is not None and topic != row.topic:
            raise _differ(f"{name} was read from {row.topic}, and the rig says {topic}.")
        size = (row.facts.get("width"), row.facts.get("height"))
        if name in sizes and sizes[name] != size:
            raise _differ(f"Images of {name} have {size[0]} x {size[1]} pixels, and the rig says {sizes[name]}.")


def _differ(what: str) -> Problem:
    return conflict("sensors_differ", what, "Correct the new rig, or upload the recording again with it.")
