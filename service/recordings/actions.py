"""Deleting a recording with all that came from it, in one transaction. The sweep removes the bytes afterwards."""

from __future__ import annotations

from collections.abc import Sequence
from uuid import UUID

from sqlalchemy import ColumnElement, delete, or_, select
from sqlalchemy.orm import Session

from apexcal.documents.publications import CURRENT
from apexcal.documents.states import VehicleState
from service.calibration_runs.conclusion import drop_calibrations
from service.platform.db.analyses import Analysis, AnalysisFile
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from service.platform.db.detections import Detection
from service.platform.db.fleet_requests import FleetRequestVehicle
from service.platform.db.recordings import Recording, UploadPart
from service.platform.http.problems import Problem
from service.platform.jobs.queue import abandon
from service.platform.storage.blobs import condemn, sensor_keys
from service.publications.actions import hold_publications
from service.publications.queries import aliases_to


def delete_recording(session: Session, recording_id: UUID, *, with_published: bool) -> None:
    """Delete a recording, its marks, detections, correspondence sets and every calibration that used them.

    Raises :class:`Problem` 409 ``calibration_in_use`` where one of these calibrations is a vehicle's current one
    or an alias leads to it, unless ``with_published``.
    """
    # Jobs first, as workers lock them before the rows that they work for; then again, for one made meanwhile.
    abandon(session, _subjects(session, recording_id))
    vehicle_id = session.scalar(select(Recording.vehicle_id).where(Recording.id == recording_id).with_for_update())
    # A retry of a fleet request holds its failed vehicles, then the sets; a cancel holds only the keys of these.
    failed = select(FleetRequestVehicle.id).where(
        FleetRequestVehicle.calibration_id.in_(_calibrations(session, recording_id)),
        FleetRequestVehicle.state == VehicleState.FAILED,
    )
    session.execute(failed.order_by(FleetRequestVehicle.id).with_for_update(key_share=True)).all()
    # A calibration being asked for holds its sets, not the recording: wait for it, so that its runs are seen below.
    session.execute(
        select(CorrespondenceSet.id).where(CorrespondenceSet.recording_id == recording_id).with_for_update()
    ).all()
    abandon(session, _subjects(session, recording_id))
    calibrations = _calibrations(session, recording_id)
    # In one order: two recordings of one vehicle share calibrations, and may be deleted at the same moment.
    shared = select(Calibration.id).where(Calibration.id.in_(calibrations)).order_by(Calibration.id)
    session.execute(shared.with_for_update()).all()
    # After the calibrations, in the same order as publishing.
    if vehicle_id is not None:
        hold_publications(session, vehicle_id)
        if not with_published:
            _refuse_in_use(session, vehicle_id, calibrations)
    keys = [
        *session.scalars(select(UploadPart.blob_key).where(UploadPart.recording_id == recording_id)),
        *sensor_keys(session, recording_id),
        *session.scalars(
            select(AnalysisFile.blob_key)
            .join(Analysis, Analysis.id == AnalysisFile.analysis_id)
            .where(_goes_with(recording_id, calibrations))
        ),
    ]
    condemn(session, keys)
    drop_calibrations(session, calibrations)
    session.execute(delete(Calibration).where(Calibration.id.in_(calibrations)))
    session.execute(delete(Recording).where(Recording.id == recording_id))


def _calibrations(session: Session, recording_id: UUID) -> Sequence[UUID]:
    return session.scalars(
        select(CalibrationRun.calibration_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(CorrespondenceSet.recording_id == recording_id)
        .distinct()
    ).all()


def _goes_with(recording_id: UUID, calibrations: Sequence[UUID]) -> ColumnElement[bool]:
    """Whether an analysis is of the recording, of its pairs, or of a result of these calibrations."""
    sets = select(CorrespondenceSet.id).where(CorrespondenceSet.recording_id == recording_id)
    results = select(Result.id).where(Result.calibration_id.in_(calibrations))
    return or_(Analysis.recording_id == recording_id, Analysis.set_id.in_(sets), Analysis.result_id.in_(results))


def _subjects(session: Session, recording_id: UUID) -> list[UUID]:
    calibrations = _calibrations(session, recording_id)
    runs = select(CalibrationRun.id).where(CalibrationRun.calibration_id.in_(calibrations))
    return [
        recording_id,
        *session.scalars(select(Analysis.id).where(_goes_with(recording_id, calibrations))),
        *session.scalars(select(Detection.id).where(Detection.recording_id == recording_id)),
        *calibrations,
        *session.scalars(runs),
    ]


def _refuse_in_use(session: Session, vehicle_id: UUID, calibrations: Sequence[UUID]) -> None:
    used = [
        f"{'current calibration' if alias == CURRENT else f'alias {alias}'} of {camera}"
        for alias, camera in aliases_to(session, vehicle_id, calibrations)
    ]
    if used:
        raise Problem(
            409,
            "calibration_in_use",
            f"The vehicle's {' and '.join(used)} came from this recording.",
            "Publish another calibration first, or delete with ?with_published=true and lose that one too.",
        )
