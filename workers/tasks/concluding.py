"""Conclude a calibration: compare its models and its cameras, and judge its results.

The process whose run ends last concludes with the data that it has in memory. Otherwise a job of its own concludes.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, Final, NamedTuple
from uuid import UUID

import numpy as np
from sqlalchemy import bindparam, func, select
from sqlalchemy.exc import OperationalError
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
from service.platform.jobs.claims import CancelledError, Claim, Lease, LostLeaseError
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
from workers.tasks.run_inputs import read_run

log = logging.getLogger(__name__)

# Built once: SQLAlchemy takes longer to build such a statement than to run it.
_RESULTS = (
    select(Result)
    .where(Result.calibration_id == bindparam("calibration"))
    .order_by(Result.camera, Result.model, Result.fold)
)
_RUNS = select(
    *(CalibrationRun.id, CalibrationRun.set_id, CalibrationRun.camera, CalibrationRun.state),
    CalibrationRun.problem,
).where(CalibrationRun.calibration_id == bindparam("calibration"))
_SEARCHES = (
    select(Slot.run_id, Slot.worker, func.sum(Slot.seconds))
    .join(CalibrationRun, CalibrationRun.id == Slot.run_id)
    .where(CalibrationRun.calibration_id == bindparam("calibration"), CalibrationRun.fold == FULL)
    .group_by(Slot.run_id, Slot.worker)
    .order_by(Slot.worker)
)


# A calibration with a cancelled run is not judged.
_JUDGED_STATES: Final = (WorkState.DONE, WorkState.FAILED)
# Moves of an alias that are looked through for a result from people's marks: two years of monthly calibrations.
_MOST_MOVES: Final = 24
_CONFIRMED: Final = MARKS_CONFIRMED.name


class _Current(NamedTuple):
    """The camera's published result at the time of judging, and the summary of its model."""

    result: Result
    published: FitResult
    summary: ModelSummary | None


class _Judged(NamedTuple):
    """A fit to all pairs in its published form, the checks of its calibration, and the current result's id."""

    result: Result
    published: FitResult
    checks: list[Check]
    current_id: UUID | None

    def verdict(self, scope: CheckScope) -> CheckVerdict:
        return verdict_of(later_checks(self.result.fit.checks, self.checks), scope)

    @property
    def columns(self) -> Json:
        """Return the columns that are written."""
        checks, verdict = [check.model_dump(mode="json") for check in self.checks], self.verdict("mount_with_lens")
        middle = self.published.prediction and self.published.prediction.middle_at(20.0)
        return {
            "id": self.result.id,
            "checks": checks,
            "verdict": verdict,
            "error_20m_mm": middle and middle[1],
            "compared_with": self.current_id,
        }


class LastRun(NamedTuple):
    """A run that ends in this process, and its result, which is not stored yet.

    ``searches``: run, worker and seconds of those parts of its search that are not stored yet.
    """

    run: Any
    result: Result
    searches: Sequence[tuple[UUID, str, float]]


def conclude(context: Context, claim: Claim, lease: Lease) -> Callable[[Session], Conclusion | None]:
    """Summarise and judge a calibration whose runs have all ended."""
    lease.report(0.0, "comparing the models")
    conclusion = _concluded(context, claim.subject_id, None, lease)
    return lambda session: conclusion


def conclude_by(context: Context, last: LastRun, stop: Stop) -> Conclusion | None:
    """Summarise and judge a calibration with the result of its last run; None while others have not ended.

    If judging fails, there is no conclusion, and the run's result is stored all the same. A job then judges again and
    reports the failure.
    """
    try:
        return _concluded(context, last.run.calibration_id, last, stop)
    except (CancelledError, LostLeaseError, OperationalError):
        raise
    except Exception:
        log.exception("calibration %s is judged by a job of its own", last.run.calibration_id)
        return None


def _concluded(context: Context, calibration_id: UUID, last: LastRun | None, stop: Stop) -> Conclusion | None:
    with context.database.reading() as session:
        calibration = session.get_one(Calibration, calibration_id)
        if last and calibration.remaining != 1:
            return None
        runs = session.execute(_RUNS, {"calibration": calibration_id}).all()
        others = [run for run in runs if last is None or run.id != last.run.id]
        if any(run.state not in _JUDGED_STATES for run in others):
            return None
        stored = list(session.scalars(_RESULTS, {"calibration": calibration_id})) if others else []
        cameras = _by_camera([*stored, last.result] if last else stored)
        fits = _fits(session, calibration_id, cameras, last)
        summaries = {camera: camera_summary(of_camera) for camera, of_camera in fits.items()}
        solved = _solved_cameras(session, calibration, cameras, summaries, stop)
        stated = _stated(session, calibration) if len(cameras) > 1 else []
        full = [result for result in stored if result.fold == FULL]
        elsewhere = other_data(session, full) if full else {}
    rig = _compared(solved, stated, summaries) if len(cameras) > 1 else None
    ended_well = all(run.state == WorkState.DONE for run in others)
    sets = {run.camera: run.set_id for run in runs}
    current: dict[str, UUID | None] = {}
    judged: list[Json] = []
    for camera, results in cameras.items():
        pairs = context.pairs_of(sets[camera])
        with context.database.reading() as session:
            beside = _current(session, calibration.vehicle_id, camera)
            confirming = _confirming(session, calibration.vehicle_id, camera) if any(pairs.get(MACHINE, ())) else None
        current[camera] = beside and beside.result.id
        for result in results:
            if result.fold == FULL:
                of_camera = (fits[camera], summaries[camera], rig, beside, elsewhere.get(result.id, ()))
                judgement = _judge(result, *of_camera, pairs, confirming, ended_well=ended_well)
                model = summaries[camera].models[result.model]
                model.verdict = judgement.verdict("mount_with_lens")
                model.verdict_alone = judgement.verdict("mount_alone")
                judged.append(judgement.columns)
    problem = next((run.problem for run in others if run.problem), None)
    summary = Summary(cameras=summaries, rig=rig)
    return Conclusion(summary, judged, current, calibration.reopened, problem) if judged else None


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
        confirming=confirming and _beside(published, confirming),
    )
    # The fit was judged by its own interval; the published interval is wider and is judged again.
    own = [mount_alone(published)] if spread else []
    return _Judged(result, published, [*own, *checks, other_data_check(elsewhere)], current and current.result.id)


def _beside(published: FitResult, current: _Current) -> CurrentResult:
    """Return a result that the vehicle has, and how far this fit is from it."""
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
    """Return the newest result that was published, passes and rests on people's marks, and was never withdrawn."""
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
    """Return results by camera, for each camera with a fit to all its pairs."""
    cameras: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        cameras[result.camera].append(result)
    return {name: fits for name, fits in cameras.items() if any(result.fold == FULL for result in fits)}


def _fits(
    session: Session, calibration: UUID, cameras: Mapping[str, Sequence[Result]], last: LastRun | None
) -> dict[str, list[CameraFit]]:
    """Return each camera's fits, with the seconds and the workers of their searches."""
    seconds: dict[UUID, float] = defaultdict(float)
    workers: dict[UUID, list[str]] = defaultdict(list)
    unstored = last.searches if last else ()
    # The only search is the last run's own, of which nothing is stored.
    alone = unstored and sum(map(len, cameras.values())) == 1
    stored = () if alone else session.connection().execute(_SEARCHES, {"calibration": calibration}).all()
    for run_id, worker, spent in (*stored, *unstored):
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
    """Compare every two cameras by their recommended results; a sentence names cameras without one."""
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
    """Return each camera's recommended result with its pairs; nothing for a rig with one camera."""
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
    problem = at_clock(read_run(run.fit_request, run.fold, pairs.columns, stop).problem, result.fit.clock_offset)
    return SolvedCamera(run.camera, problem, result.fit, pairs.columns, detection)


def _stated(session: Session, calibration: Calibration) -> list[StatedTransform]:
    """Return T_cameraA_cameraB by the nominal mounts of every two cameras, and by the rig's `camera_transforms`."""
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
