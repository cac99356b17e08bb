"""The last job of a calibration: its models compared, its cameras compared, its results judged."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final, NamedTuple
from uuid import UUID

import numpy as np
from sqlalchemy import bindparam, func, select
from sqlalchemy.orm import Session

from apexcal.documents.checks import MARKS_CONFIRMED, Check, CheckScope, CheckVerdict, later_checks, verdict_of
from apexcal.documents.errors import GeometryError
from apexcal.documents.jobs import ProblemView
from apexcal.documents.pairs import MACHINE
from apexcal.documents.publications import CURRENT
from apexcal.documents.results import FitResult
from apexcal.documents.states import WorkState
from apexcal.documents.summaries import CameraSummary, ModelSummary, RigSummary, Summary
from apexcal.geometry.image_frames import T_images_camera
from apexcal.geometry.result_differences import compared
from apexcal.geometry.se3 import from_document
from service.platform.db.base import Json
from service.platform.db.calibrations import (
    FULL,
    Calibration,
    CalibrationRun,
    CorrespondenceSet,
    Result,
    Slot,
    current_publication,
    moves_of,
)
from service.platform.db.fleets import Rig
from service.platform.handovers import Conclusion
from service.platform.jobs.claims import Claim, Lease
from workers.judge.calibration_checks import CurrentResult, checks_of_calibration
from workers.judge.held_out_check import held_out_pairs
from workers.judge.precision_checks import mount_alone
from workers.judge.validation_checks import elsewhere as other_data_check
from workers.models.summary import CameraFit, camera_summary
from workers.solver.estimate import at_clock
from workers.solver.outcomes import Stop
from workers.solver.rig_consistency import SolvedCamera, StatedTransform, rig_consistency
from workers.tasks.context import Context
from workers.tasks.other_data import other_data
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


# Moves of an alias that are looked through for a result from people's marks: a year of monthly calibrations, twice.
_MOST_MOVES: Final = 24
_CONFIRMED: Final = MARKS_CONFIRMED.name


class _Current(NamedTuple):
    """What a camera is given while its new results are judged, as published, and the summary of its model."""

    result: Result
    published: FitResult
    summary: ModelSummary | None


class _Judged(NamedTuple):
    """A fit to all pairs, as it is published, with the checks of its calibration, and the current result then."""

    result: Result
    published: FitResult
    checks: list[Check]
    current_id: UUID | None

    def verdict(self, scope: CheckScope) -> CheckVerdict:
        return verdict_of(later_checks(self.result.fit.checks, self.checks), scope)

    @property
    def columns(self) -> Json:
        """What is written of it."""
        checks, verdict = [check.model_dump(mode="json") for check in self.checks], self.verdict("mount_with_lens")
        middle = self.published.prediction and self.published.prediction.middle_at(20.0)
        return {
            "id": self.result.id,
            "checks": checks,
            "verdict": verdict,
            "error_20m_mm": middle and middle[1],
            "compared_with": self.current_id,
        }


def conclude(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Conclusion]:
    """Summarise and judge a calibration whose runs have all ended."""
    with context.database.reading() as session:
        calibration = session.get_one(Calibration, claim.subject_id)
        cameras = _by_camera(session.scalars(_RESULTS, {"calibration": calibration.id}).all())
        fits = _fits(session, calibration.id, cameras)
        lease.report(0.0, "comparing the models")
        summaries = {camera: camera_summary(of_camera) for camera, of_camera in fits.items()}
        solved = _solved_cameras(session, calibration, cameras, summaries, lease)
        stated = _stated(session, calibration) if len(cameras) > 1 else []
        of_runs = select(CalibrationRun.id, CalibrationRun.set_id, CalibrationRun.state, CalibrationRun.failure)
        runs = session.execute(of_runs.where(CalibrationRun.calibration_id == calibration.id)).all()
        sets = {run.id: run.set_id for run in runs}
        current = {camera: _current(session, calibration.vehicle_id, camera) for camera in cameras}
        confirming = {camera: _confirming(session, calibration.vehicle_id, camera) for camera in cameras}
        elsewhere = other_data(
            session, [judgement for every in cameras.values() for judgement in every if judgement.fold == FULL]
        )
    rig = _compared(solved, stated, summaries) if len(cameras) > 1 else None
    ended_well = all(run.state == WorkState.DONE for run in runs)
    judged = [
        _judge(
            *(result, fits[camera], summaries[camera], rig, current[camera], elsewhere[result.id]),
            context.pairs_of(sets[result.run_id]),
            confirming[camera],
            ended_well=ended_well,
        )
        for camera, of_camera in cameras.items()
        for result in of_camera
        if result.fold == FULL
    ]
    for judgement in judged:
        model = summaries[judgement.result.camera].models[judgement.result.model]
        model.verdict, model.verdict_alone = judgement.verdict("mount_with_lens"), judgement.verdict("mount_alone")
    conclusion = Conclusion(
        Summary(cameras=summaries, rig=rig),
        [judgement.columns for judgement in judged],
        {camera: judgement and judgement.result.id for camera, judgement in current.items()},
        next((run.failure for run in runs if run.failure), None),
    )
    return lambda session: conclusion


def _judge(
    result: Result,
    fits: Sequence[CameraFit],
    summary: CameraSummary,
    rig: RigSummary | None,
    current: _Current | None,
    elsewhere: Sequence[Json],
    pairs: Json,
    confirming: _Current | None,
    *,
    ended_well: bool,
) -> _Judged:
    """Judge a fit beside the other fits of its calibration, and beside what the vehicle has."""
    folds = [fit.result for fit in fits if fit.result.model == result.model and fit.heldout_fold is not None]
    points = np.column_stack([pairs[name] for name in "xyz"]).astype(np.float64)
    model = summary.models[result.model]
    other = None if current is None or current.result.id == result.id else current
    fit, spread = result.fit, model.between_models
    published = FitResult.model_validate(fit.model_dump() | spread.members()) if spread else fit
    checks = checks_of_calibration(
        fit,
        camera=result.camera,
        summary=summary,
        ended_well=ended_well,
        pairs=held_out_pairs(fit, folds, points),
        rig=rig,
        current=other and _beside(published, other),
        columns=pairs,
        confirming=_beside(published, confirming) if confirming and any(pairs.get(MACHINE, ())) else None,
    )
    # What a check of the fit says of its interval holds for the published one.
    own = [mount_alone(published)] if spread else []
    return _Judged(result, published, [*own, *checks, other_data_check(elsewhere)], current and current.result.id)


def _beside(published: FitResult, current: _Current) -> CurrentResult:
    """What the vehicle has, and how far this fit is from it."""
    result, standard, summary = current
    return CurrentResult(
        result=standard,
        verdict=result.verdict,
        compared=compared(published, standard),
        heldout_mean_px=summary and summary.heldout_mean_px,
    )


def _current(session: Session, vehicle_id: UUID, camera: str) -> _Current | None:
    publication = current_publication(session, vehicle_id, camera)
    if publication is None:
        return None
    result = session.get_one(Result, publication.result_id)
    return _Current(result, result.published, result.summary)


def _confirming(session: Session, vehicle_id: UUID, camera: str) -> _Current | None:
    """The newest result that the camera was given, passes and stands on people's marks; none that was withdrawn."""
    withdrawn: set[UUID | None] = set()
    ends_next = False
    for move in session.scalars(moves_of(vehicle_id, camera, CURRENT).limit(_MOST_MOVES)):
        if ends_next:
            withdrawn.add(move.led_to)
        ends_next = move.led_to is None
        result = session.get(Result, move.result_id) if move.result_id else None
        if result is None or result.id in withdrawn or result.verdict != "pass":
            continue
        machine = next(
            (check.figures.get("machine") for check in result.stored_checks if check.name == _CONFIRMED), None
        )
        if machine == 0.0:
            return _Current(result, result.published, result.summary)
    return None


def _by_camera(results: Sequence[Result]) -> dict[str, list[Result]]:
    """The results of each camera that has a fit to all its pairs."""
    cameras: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        cameras[result.camera].append(result)
    return {name: fits for name, fits in cameras.items() if any(result.fold == FULL for result in fits)}


def _fits(session: Session, calibration: UUID, cameras: Mapping[str, Sequence[Result]]) -> dict[str, list[CameraFit]]:
    """Each camera's fits, with the seconds of their searches and who did them."""
    seconds: dict[UUID, float] = defaultdict(float)
    workers: dict[UUID, list[str]] = defaultdict(list)
    for run_id, worker, spent in session.connection().execute(_SEARCHES, {"calibration": calibration}):
        seconds[run_id] += spent
        workers[run_id].append(worker)
    return {
        camera: [
            CameraFit(
                *(result.id, None if result.fold == FULL else result.fold, result.fit),
                *(seconds[result.run_id], workers[result.run_id]),
            )
            for result in results
        ]
        for camera, results in cameras.items()
    }


def _compared(
    solved: Sequence[SolvedCamera], stated: Sequence[StatedTransform], summaries: Mapping[str, CameraSummary]
) -> RigSummary:
    """Every two cameras compared by their recommended results; cameras without one are left out, with a sentence."""
    left_out = [
        f"{camera} is not compared with the others: no model is recommended for it."
        for camera, summary in summaries.items()
        if summary.recommended is None
    ]
    try:
        pairs = rig_consistency(solved, stated)
    except GeometryError as error:
        problem = ProblemView(code=error.code, detail=error.message, hint=error.hint)
        return RigSummary(pairs=[], alarms=[], left_out=left_out, problem=problem)
    alarms = [alarm for pair in pairs for alarm in pair.alarms]
    return RigSummary(pairs=pairs, alarms=alarms, left_out=left_out, problem=None)


def _solved_cameras(
    session: Session,
    calibration: Calibration,
    cameras: Mapping[str, Sequence[Result]],
    summaries: Mapping[str, CameraSummary],
    stop: Stop,
) -> list[SolvedCamera]:
    """Each camera's recommended result with the pairs that it was fitted to; none of a rig with one camera."""
    if len(cameras) < 2:
        return []
    rows = session.execute(
        select(CalibrationRun, CorrespondenceSet)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(CalibrationRun.calibration_id == calibration.id, CalibrationRun.fold == FULL)
    )
    runs = {run.id: (run, pairs) for run, pairs in rows}
    return [
        _solved(*runs[result.run_id], result, stop)
        for camera, results in cameras.items()
        for result in results
        if result.fold == FULL and result.model == summaries[camera].recommended
    ]


def _solved(run: CalibrationRun, pairs: CorrespondenceSet, result: Result, stop: Stop) -> SolvedCamera:
    detection = str(pairs.detection_id) if pairs.detection_id else None
    problem = at_clock(read_run(run.problem, run.fold, pairs.columns, stop).problem, result.fit.clock_offset)
    return SolvedCamera(run.camera, problem, result.fit, pairs.columns, detection)


def _stated(session: Session, calibration: Calibration) -> list[StatedTransform]:
    """T_cameraA_cameraB by the nominal mounts of every two cameras, and as the rig knows it otherwise."""
    rig = session.get_one(Rig, calibration.rig_id)
    nominal = combinations((from_document(camera.nominal) for camera in rig.cameras), 2)
    stated = [StatedTransform(a @ b.inverse(), "nominal") for a, b in nominal] + [
        StatedTransform(from_document(edge["transform"]), "rig", edge["std_deg"], 1e-3 * edge["std_mm"])
        for edge in rig.camera_transforms or []
    ]
    turns = [from_document(T_images_camera(edge.frame, edge.images)) for edge in rig.cameras]
    by_frame = {turn.from_frame: turn for turn in turns}
    # Results lead to the frames of the images.
    return [
        replace(edge, transform=by_frame[mount.to_frame] @ mount @ by_frame[mount.from_frame].inverse())
        for edge in stated
        for mount in [edge.transform]
    ]
