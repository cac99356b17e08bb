"""The last job of a calibration: its models compared, its cameras compared, its summary and its publications."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from uuid import UUID

from sqlalchemy import bindparam, func, select
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.calibration_runs.conclusion import RunRow, end_calibration, runs_of
from service.calibration_runs.image_frames import T_images_camera
from service.calibration_runs.objection_queries import objections, own_objections
from service.db.base import Json
from service.db.calibrations import FULL, Calibration, CalibrationRun, CorrespondenceSet, Result, Slot
from service.db.fleets import Rig
from service.jobs.claims import Claim, Lease
from service.publications.actions import hold_publications, publish_by_itself
from workers.geometry.errors import GeometryError
from workers.geometry.transforms import from_document
from workers.models.summary import Fit, camera_summary
from workers.solver.rig_consistency import SolvedCamera, StatedTransform, rig_consistency
from workers.solver.stopping import Stop
from workers.tasks.context import Context
from workers.tasks.solving import read_run

# Built once: SQLAlchemy takes longer to build such a statement than to run it.
_RESULTS = (
    select(Result)
    .where(Result.calibration_id == bindparam("calibration"))
    .order_by(Result.camera, Result.model, Result.fold)
)
_SEARCHES = (
    select(Slot.run_id, Slot.worker, func.sum(Slot.seconds))
    .join(CalibrationRun, CalibrationRun.id == Slot.run_id)
    .where(CalibrationRun.calibration_id == bindparam("calibration"), CalibrationRun.fold == FULL)
    .group_by(Slot.run_id, Slot.worker)
    .order_by(Slot.worker)
)


def conclude(context: Context, held: Claim, lease: Lease) -> Callable[[Session], None]:
    """Summarise a calibration whose runs have all ended, and publish what is recommended where that was asked for."""
    with context.database.reading() as session:
        calibration = session.get_one(Calibration, held.subject_id)
        runs, results = runs_of(session, calibration.id), session.scalars(_RESULTS, {"calibration": calibration.id})
        cameras = _by_camera(results.all())
        fits = _fits(session, calibration.id, cameras)
        lease.report(0.0, "comparing the models")
        summaries = {camera: camera_summary(of_camera) for camera, of_camera in fits.items()}
        solved = _solved_cameras(session, calibration.id, cameras, summaries, lease)
        stated = _stated(session, calibration.rig_id) if len(cameras) > 1 else []
    rig = _compared(solved, stated, summaries) if len(cameras) > 1 else None
    ended_well = all(run.state == WorkState.DONE for run in runs)
    for camera, found in summaries.items():
        for name, model in found["models"].items():
            model["objections"] = own_objections(camera, found, name, rig, ended_well=ended_well)

    def write(session: Session) -> None:
        calibration = session.get_one(Calibration, held.subject_id, with_for_update=True)
        _end(session, calibration, runs, {"cameras": summaries} | ({} if rig is None else {"rig": rig}))

    return write


def _end(session: Session, calibration: Calibration, runs: Sequence[RunRow], summary: Json) -> None:
    """End the calibration with its summary, and publish what is recommended and nothing speaks against."""
    problem = next((run.failure for run in runs if run.failure), None)
    calibration.summary = summary
    if calibration.publish == "recommended":
        # The calibration's row before the vehicle's: the order of all locks.
        session.flush()
        hold_publications(session, calibration.vehicle_id)
        cameras = {
            camera: found | _published(session, calibration, found) for camera, found in summary["cameras"].items()
        }
        summary = summary | {"cameras": cameras}
    end_calibration(session, calibration, WorkState.DONE, problem, summary)


def _published(session: Session, calibration: Calibration, found: Json) -> Json:
    """Publish a camera's recommended result, or say why not."""
    chosen = found["models"].get(found["recommended"])
    if chosen is None:
        return {"published": False, "not_published": ["No model is recommended."]}
    result = session.get_one(Result, UUID(chosen["result_id"]))
    reasons = objections(session, result)
    if not reasons:
        publish_by_itself(session, calibration, result)
    return {"published": not reasons, "not_published": reasons}


def _by_camera(results: Sequence[Result]) -> dict[str, list[Result]]:
    """The results of each camera that has a fit to all its pairs."""
    cameras: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        cameras[result.camera].append(result)
    return {name: found for name, found in cameras.items() if any(result.fold == FULL for result in found)}


def _fits(session: Session, calibration_id: UUID, cameras: Mapping[str, Sequence[Result]]) -> dict[str, list[Fit]]:
    """Each camera's fits, with the seconds of their searches and who did them."""
    seconds: dict[UUID, float] = defaultdict(float)
    workers: dict[UUID, list[str]] = defaultdict(list)
    for run_id, worker, spent in session.connection().execute(_SEARCHES, {"calibration": calibration_id}):
        seconds[run_id] += spent
        workers[run_id].append(worker)
    return {
        camera: [
            Fit(
                *(result.id, result.model, None if result.fold == FULL else result.fold, result.document),
                *(seconds[result.run_id], workers[result.run_id]),
            )
            for result in results
        ]
        for camera, results in cameras.items()
    }


def _compared(
    solved: Sequence[SolvedCamera], stated: Sequence[StatedTransform], summaries: Mapping[str, Json]
) -> Json:
    """Every two cameras compared by their recommended results; cameras without one are left out, with a sentence."""
    try:
        compared = rig_consistency(solved, stated)
    except GeometryError as error:
        problem = {"code": error.code, "detail": error.message, "hint": error.hint}
        compared = {"pairs": [], "alarms": [], "problem": problem}
    compared["left_out"] = [
        f"{camera} is not compared with the others: no model is recommended for it."
        for camera, found in summaries.items()
        if found["recommended"] is None
    ]
    return compared


def _solved_cameras(
    session: Session,
    calibration_id: UUID,
    cameras: Mapping[str, Sequence[Result]],
    summaries: Mapping[str, Json],
    stop: Stop,
) -> list[SolvedCamera]:
    """Each camera's recommended result with the pairs that it was fitted to; none of a rig with one camera."""
    if len(cameras) < 2:
        return []
    rows = session.execute(
        select(CalibrationRun, CorrespondenceSet)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(CalibrationRun.calibration_id == calibration_id, CalibrationRun.fold == FULL)
    )
    runs = {run.id: (run, pairs) for run, pairs in rows}
    return [
        _solved(*runs[result.run_id], result, stop)
        for camera, results in cameras.items()
        for result in results
        if result.fold == FULL and result.model == summaries[camera]["recommended"]
    ]


def _solved(run: CalibrationRun, pairs: CorrespondenceSet, result: Result, stop: Stop) -> SolvedCamera:
    detection = str(pairs.detection_id) if pairs.detection_id else None
    problem = read_run(run.problem, run.fold, pairs.columns, stop).problem
    return SolvedCamera(run.camera, problem, result.document, pairs.columns, detection)


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
