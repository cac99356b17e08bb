"""The end of a calibration: what its runs found side by side, which model to take and why, and its publication."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise
from math import sqrt
from uuid import UUID

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db.base import Json
from service.db.calibrations import Calibration, CalibrationRun, Publication, Result, Slot
from service.db.clock import utc_now

FULL = -1


def conclude(session: Session, calibration: Calibration) -> None:
    """Give the calibration its final state, its summary and, where asked for, its publications."""
    of_calibration = select(CalibrationRun).where(CalibrationRun.calibration_id == calibration.id)
    # The end of the last run was an UPDATE that this session's objects have not seen.
    runs = session.scalars(of_calibration.execution_options(populate_existing=True)).all()
    results = session.scalars(select(Result).where(Result.calibration_id == calibration.id)).all()
    fitted = [result for result in results if result.fold == FULL]
    calibration.finished_at = utc_now()
    calibration.state = _state(runs, fitted)
    calibration.problem = next((run.failure for run in runs if run.failure), None)
    if not fitted:
        return
    work = _work(session, calibration.id)
    cameras: dict[str, Json] = {}
    for camera in sorted({result.camera for result in fitted}):
        of_camera = [result for result in results if result.camera == camera]
        models = {r.model: _model_summary(r, of_camera, work[r.run_id]) for r in of_camera if r.fold == FULL}
        recommended, why = _recommend(models)
        cameras[camera] = {"recommended": recommended, "why": why, "models": models}
        if calibration.publish == "recommended" and recommended and _proven(runs, models[recommended]):
            _publish(session, calibration, camera, UUID(models[recommended]["result_id"]))
    calibration.summary = {"cameras": cameras}


def _proven(runs: Sequence[CalibrationRun], recommended: Json) -> bool:
    """A vehicle is given by itself only what was judged on pairs that it was not fitted to, with every run done."""
    return recommended["heldout_pairs"] > 0 and all(run.state == "done" for run in runs)


def _state(runs: Sequence[CalibrationRun], fitted: Sequence[Result]) -> str:
    if any(run.state == "cancelled" for run in runs):
        return "cancelled"
    return "done" if fitted else "failed"


def _work(session: Session, calibration_id: UUID) -> dict[UUID, Json]:
    """Compute seconds, workers and finished iterations of each run."""
    rows = session.execute(
        select(Slot.run_id, Slot.worker, func.sum(Slot.seconds), func.sum(Slot.evaluations))
        .join(CalibrationRun, CalibrationRun.id == Slot.run_id)
        .where(CalibrationRun.calibration_id == calibration_id)
        .group_by(Slot.run_id, Slot.worker)
        .order_by(Slot.worker)
    )
    work: dict[UUID, Json] = defaultdict(lambda: {"workers": [], "ga_seconds": 0.0, "evaluations": 0})
    for run_id, worker, seconds, evaluations in rows:
        entry = work[run_id]
        entry["workers"].append(worker)
        entry["ga_seconds"] += seconds
        entry["evaluations"] += evaluations
    return work


def _model_summary(full: Result, of_camera: Sequence[Result], work: Json) -> Json:
    document = full.document
    heldout = [
        error
        for result in of_camera
        if result.model == full.model and result.fold != FULL
        for error in result.document.get("heldout", {}).get("errors_px", [])
    ]
    summary: Json = {stage: _stage(document[stage]) for stage in ("ga", "polished", "baseline")}
    return summary | {
        "result_id": str(full.id),
        "status": document["status"],
        "pairs": document["pairs"],
        "iterations": document["iterations"],
        "stopped": document["stopped"],
        "alarms": document["alarms"],
        "heldout_mean_px": sum(heldout) / len(heldout) if heldout else None,
        "heldout_rms_px": sqrt(sum(e * e for e in heldout) / len(heldout)) if heldout else None,
        "heldout_pairs": len(heldout),
        "seconds": work["ga_seconds"] + document.get("finish_seconds", 0.0),
        "workers": work["workers"],
    }


def _stage(stage: Json) -> Json:
    return {"mean_px": stage["mean_px"], "rms_px": stage["rms_px"]}


def _recommend(models: dict[str, Json]) -> tuple[str | None, str]:
    """The model with the lowest mean error on held-out pairs, or on all pairs where none were held out of any."""
    held = {model["heldout_pairs"] for model in models.values()}
    if len(held) > 1:
        return None, (
            "The models cannot be compared: not the same pairs were held out of each (too few pairs for the larger "
            "models, or a run that failed). Ask again with more pairs, fewer folds or fewer models."
        )
    which, key = (
        ("the fitted pairs themselves, for none were held out", lambda model: model["polished"]["mean_px"])
        if held == {0}
        else ("held-out pairs", lambda model: model["heldout_mean_px"])
    )
    errors: dict[str, float] = {name: key(model) for name, model in models.items()}
    ranked = sorted(errors, key=lambda name: (errors[name], name))
    why = f"{ranked[0]} has the lowest mean error on {which}: {errors[ranked[0]]:.2f} px"
    others = [f"{b} is {errors[b] - errors[a]:.2f} px behind {a}" for a, b in pairwise(ranked)]
    return ranked[0], "; ".join([why, *others]) + "."


def _publish(session: Session, calibration: Calibration, camera: str, result_id: UUID) -> None:
    session.add(
        Publication(
            fleet_id=calibration.fleet_id,
            vehicle_id=calibration.vehicle_id,
            camera=camera,
            result_id=result_id,
            published_by=calibration.created_by,
        )
    )
