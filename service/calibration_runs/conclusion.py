"""The end of a calibration: the summary of its runs, the recommended model and why, and its publication."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple
from uuid import UUID

from sqlalchemy import bindparam, func, select
from sqlalchemy.orm import Session

from apexcal.documents.states import WorkState
from service.calibration_runs.objection_queries import objections, own_objections
from service.db.base import Json
from service.db.calibrations import FULL, Calibration, CalibrationRun, Result, Slot
from service.db.clock import now
from service.publications.actions import hold_publications, publish_by_itself


class RunRow(NamedTuple):
    """What the end of a calibration asks of each of its runs; ``fold`` is FULL for a fit to all pairs."""

    camera: str
    fold: int
    state: str
    cancel_requested: bool
    failure: Json | None


# Built once: SQLAlchemy takes longer to build such a statement than to run it.
_RUNS = select(*(getattr(CalibrationRun, name) for name in RunRow._fields)).where(
    CalibrationRun.calibration_id == bindparam("calibration")
)
_RESULTS = select(Result).where(Result.calibration_id == bindparam("calibration"))
_WORK = (
    select(Slot.run_id, Slot.worker, func.sum(Slot.seconds), func.sum(Slot.evaluations))
    .join(CalibrationRun, CalibrationRun.id == Slot.run_id)
    .where(CalibrationRun.calibration_id == bindparam("calibration"))
    .group_by(Slot.run_id, Slot.worker)
    .order_by(Slot.worker)
)


def conclude(
    session: Session,
    calibration: Calibration,
    runs: Sequence[RunRow],
    *,
    rig: Json | None = None,
    cancelled: bool = False,
) -> None:
    """Give the calibration its final state, its summary and, where asked for, its publications.

    ``rig``: what the comparison of its cameras found; ``cancelled`` where that was cancelled.
    """
    results = results_of(session, calibration.id)
    fitted = [result for result in results if result.fold == FULL]
    calibration.finished_at = now()
    calibration.state = WorkState.CANCELLED if cancelled else _state(runs, fitted)
    calibration.problem = next((run.failure for run in runs if run.failure), None)
    if not fitted:
        return
    work = _work(session, calibration.id)
    ended_well = not cancelled and all(run.state == WorkState.DONE for run in runs)
    cameras: dict[str, Json] = {}
    # Imported here: it needs NumPy, which takes a twentieth of the service's start.
    from service.calibration_runs.camera_summary import camera_summary

    for camera, of_camera in by_camera(results).items():
        found = cameras[camera] = camera_summary(of_camera, work)
        for name, model in found["models"].items():
            model["objections"] = own_objections(camera, found, name, rig, ended_well=ended_well)
    calibration.summary = summary = {"cameras": cameras} if rig is None else {"cameras": cameras, "rig": rig}
    if calibration.publish == "recommended":
        calibration.summary = summary | {"cameras": _published(session, calibration, cameras, fitted)}


def _published(
    session: Session, calibration: Calibration, cameras: Mapping[str, Json], fitted: Sequence[Result]
) -> dict[str, Json]:
    """Publish what is recommended and nothing speaks against; the cameras' summaries with what became of it."""
    # The calibration's row before the vehicle's: the order of all locks.
    session.flush()
    hold_publications(session, calibration.vehicle_id)
    told: dict[str, Json] = {}
    for camera, found in cameras.items():
        result = next((one for one in fitted if (one.camera, one.model) == (camera, found["recommended"])), None)
        reasons = objections(session, result) if result else ["No model is recommended."]
        if result and not reasons:
            publish_by_itself(session, calibration, result)
        told[camera] = found | {"published": not reasons, "not_published": reasons}
    return told


def runs_of(session: Session, calibration_id: UUID) -> Sequence[RunRow]:
    """How the calibration's runs stand in the database, whatever this session has loaded of them."""
    return [RunRow(*row) for row in session.connection().execute(_RUNS, {"calibration": calibration_id})]


def results_of(session: Session, calibration_id: UUID) -> Sequence[Result]:
    """Everything that the calibration's runs found."""
    return session.scalars(_RESULTS, {"calibration": calibration_id}).all()


def by_camera(results: Sequence[Result]) -> dict[str, list[Result]]:
    """The results of each camera that has a fit to all its pairs; in the order of names, models and folds."""
    cameras: dict[str, list[Result]] = defaultdict(list)
    for result in sorted(results, key=lambda result: (result.camera, result.model, result.fold)):
        cameras[result.camera].append(result)
    return {name: found for name, found in cameras.items() if any(result.fold == FULL for result in found)}


def _state(runs: Sequence[RunRow], fitted: Sequence[Result]) -> WorkState:
    if any(run.state == WorkState.CANCELLED for run in runs):
        return WorkState.CANCELLED
    return WorkState.DONE if fitted else WorkState.FAILED


def _work(session: Session, calibration_id: UUID) -> dict[UUID, Json]:
    """Compute seconds, workers and finished iterations of each run."""
    rows = session.connection().execute(_WORK, {"calibration": calibration_id})
    work: dict[UUID, Json] = defaultdict(lambda: {"workers": [], "ga_seconds": 0.0, "evaluations": 0})
    for run_id, worker, seconds, evaluations in rows:
        entry = work[run_id]
        entry["workers"].append(worker)
        entry["ga_seconds"] += seconds
        entry["evaluations"] += evaluations
    return work
