"""The last job of a calibration of several cameras: compare their recommended results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.results import FitResult
from service.calibration_runs.actions import end_calibration
from service.calibration_runs.camera_summary import recommend
from service.calibration_runs.conclusion import by_camera, results_of, runs_of
from service.calibration_runs.image_frames import T_images_camera
from service.db.calibrations import FULL, Calibration, CalibrationRun, CorrespondenceSet, Result
from service.db.fleets import Rig
from service.jobs.claims import Claim, Lease
from workers.geometry.transforms import from_document
from workers.solver.rig_consistency import SolvedCamera, StatedTransform, rig_consistency
from workers.solver.stopping import Stop
from workers.tasks.context import Context
from workers.tasks.solving import read_run


def consistency(context: Context, held: Claim, lease: Lease) -> Callable[[Session], None]:
    """Compare every two cameras of a calibration, and end it with what that says."""
    with context.database.reading() as session:
        calibration = session.get_one(Calibration, held.subject_id)
        cameras, left_out = _cameras(session, calibration, lease)
        stated = _stated(session, calibration.rig_id)
    lease.report(0.0, "comparing the cameras")
    found = rig_consistency(cameras, stated)
    found["left_out"] = left_out

    def write(session: Session) -> None:
        calibration = session.get_one(Calibration, held.subject_id, with_for_update=True)
        end_calibration(session, calibration, runs_of(session, calibration.id), rig=found)

    return write


def _cameras(session: Session, calibration: Calibration, stop: Stop) -> tuple[list[SolvedCamera], list[str]]:
    """Each camera's recommended result, and sentences about cameras that have none."""
    results = results_of(session, calibration.id)
    recommended = {camera: recommend(found)[0].recommended for camera, found in by_camera(results).items()}
    runs = {
        (run.camera, run.model): (run, pairs)
        for run, pairs in session.execute(
            select(CalibrationRun, CorrespondenceSet)
            .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
            .where(CalibrationRun.calibration_id == calibration.id, CalibrationRun.fold == FULL)
        )
    }
    of_result = {(one.camera, one.model): one for one in results if one.fold == FULL}
    solved = [
        _solved(*runs[camera, model], of_result[camera, model], stop)
        for camera, model in recommended.items()
        if model
    ]
    left_out = [
        f"{camera} is not compared with the others: no model is recommended for it."
        for camera, model in recommended.items()
        if model is None
    ]
    return solved, left_out


def _solved(run: CalibrationRun, pairs: CorrespondenceSet, result: Result, stop: Stop) -> SolvedCamera:
    detection = str(pairs.detection_id) if pairs.detection_id else None
    problem = read_run(run.problem, run.fold, pairs.columns, stop).problem
    return SolvedCamera(run.camera, problem, FitResult.model_validate(result.document), pairs.columns, detection)


def _stated(session: Session, rig_id: UUID) -> list[StatedTransform]:
    """T_cameraA_cameraB by the nominal mounts of every two cameras, and as the rig knows it otherwise."""
    rig = session.get_one(Rig, rig_id)
    nominal = combinations((from_document(camera.nominal) for camera in rig.cameras), 2)
    stated = [StatedTransform(a @ b.inverse(), "nominal") for a, b in nominal] + [
        StatedTransform(from_document(one["transform"]), "rig", one["std_deg"], 1e-3 * one["std_mm"])
        for one in rig.camera_transforms or []
    ]
    turns = [from_document(T_images_camera(one.frame, one.images)) for one in rig.cameras]
    by_frame = {turn.from_frame: turn for turn in turns}
    # Results lead to the frames of the images.
    return [
        replace(one, transform=by_frame[known.to_frame] @ known @ by_frame[known.from_frame].inverse())
        for one in stated
        for known in [one.transform]
    ]
