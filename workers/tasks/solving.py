"""A calibration run's work: a whole run, a bundle of slots, or the finish. Every way calls the same compiled slot."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from service.db.base import Json
from service.db.calibrations import CalibrationRun, CorrespondenceSet, Result, Slot
from service.jobs.claims import CancelledError, Claim, Lease
from service.jobs.solving import count_down, end_run, start_finish, start_iteration
from workers.solver.covariances import COLUMNS as COVARIANCE_COLUMNS
from workers.solver.covariances import covariances_of
from workers.solver.folds import folds
from workers.solver.problem import FitProblem, problem_from_document
from workers.solver.provenance import pairs_sha256, sources_sha256
from workers.solver.schedule import (
    State,
    advance,
    bounds_of,
    from_document,
    run_schedule,
    start,
    to_document,
)
from workers.solver.slot import SlotOutcome, run_slot
from workers.solver.solution import evaluate, solve_finish
from workers.tasks.context import Context

Write = Callable[[Session], None]


@dataclass(frozen=True, eq=False)
class Fit:
    """A run as the solver sees it: the pairs it fits, the pairs held out, where its schedule stands."""

    run: CalibrationRun
    problem: FitProblem
    pairs: Json
    heldout: NDArray[np.int64]
    points: NDArray[np.float64]
    pixels: NDArray[np.float64]

    @property
    def state(self) -> State:
        """The schedule after the iterations that are on record."""
        return from_document(self.run.schedule) if self.run.schedule else start(self.problem)


def solve(context: Context, held: Claim, lease: Lease) -> Write:
    """Do one part of a run: see the payloads in :mod:`service.jobs.solving`."""
    with context.database.reading() as session:
        run = session.get_one(CalibrationRun, held.subject_id)
        pairs = session.get_one(CorrespondenceSet, run.set_id).pairs
    if run.state not in ("queued", "running") or run.cancel_requested:
        raise CancelledError
    fit = _fit(run, pairs)
    part = held.payload["part"]
    if part == "slots":
        return _slots(context, fit, lease, held.payload)
    if part == "finish":
        return _finish(fit, fit.state)
    return _whole(context, fit, lease)


def fit_problem(run: CalibrationRun, pairs: Json) -> FitProblem:
    """What a run fits: the pairs of its set, without those that its fold holds out."""
    return _fit(run, pairs).problem


def _fit(run: CalibrationRun, pairs: Json) -> Fit:
    points = np.column_stack([pairs["x"], pairs["y"], pairs["z"]]).astype(np.float64)
    pixels = np.column_stack([pairs["u"], pairs["v"]]).astype(np.float64)
    document = dict(run.problem)
    count = document.pop("folds", 0)
    heldout = _blocks(pairs, count)[run.fold] if run.fold >= 0 else np.array([], np.int64)
    fitted = np.setdiff1d(np.arange(len(points)), heldout)
    covariances = None
    if document.get("weights") == "covariances":
        known = {name: np.asarray(pairs[name])[fitted] for name in COVARIANCE_COLUMNS if name in pairs}
        covariances = covariances_of(known, points[fitted], float(document.get("mark_sigma_px") or 1.0))
    problem = problem_from_document(document, points[fitted], pixels[fitted], covariances=covariances)
    return Fit(run, problem, pairs, heldout, points, pixels)


def _blocks(pairs: Json, count: int) -> Sequence[NDArray[np.int64]]:
    """Whole poses where pairs have groups, else blocks in time, else blocks in the order of the pairs."""
    known: Sequence[Any] = pairs.get("group") or pairs.get("stamp_ns") or range(len(pairs["x"]))
    return folds(known, count)


def _slots(context: Context, fit: Fit, lease: Lease, payload: Json) -> Write:
    """Some slots of the running iteration."""
    iteration = payload["iteration"]
    lower, upper = (bound.tolist() for bound in bounds_of(fit.problem, fit.state))
    rows: list[Json] = []
    for slot in range(payload["first"], payload["stop"]):
        lease.check()
        began = time.perf_counter()
        outcome = run_slot(fit.problem, lower, upper, iteration, slot)
        rows.append(_slot_row(context, fit, iteration, slot, outcome, time.perf_counter() - began))

    def write(session: Session) -> None:
        session.execute(insert(Slot), rows)
        run = count_down(session, fit.run.id)
        if run:
            _next_iteration(session, run, fit.problem)

    return write


def _next_iteration(session: Session, run: CalibrationRun, problem: FitProblem) -> None:
    """Narrow the bounds about the best of all slots, and go on or stop. The caller took the last bundle."""
    rows = session.scalars(
        select(Slot).where(Slot.run_id == run.id, Slot.iteration == run.iteration).order_by(Slot.slot)
    ).all()
    outcomes = [SlotOutcome(row.loss, tuple(row.parameters), row.evaluations) for row in rows]
    state = advance(problem, from_document(run.schedule) if run.schedule else start(problem), outcomes)
    run.schedule = to_document(state)
    run.iteration += 1
    session.flush()
    if run.cancel_requested:
        end_run(session, run, "cancelled")
    elif state.stopped:
        start_finish(session, run)
    else:
        start_iteration(session, run)


def _whole(context: Context, fit: Fit, lease: Lease) -> Write:
    """All iterations and the finish in one job."""
    rows: list[Json] = []
    began = time.perf_counter()

    def on_slot(iteration: int, slot: int, outcome: SlotOutcome) -> None:
        nonlocal began
        rows.append(_slot_row(context, fit, iteration, slot, outcome, time.perf_counter() - began))
        lease.check()
        began = time.perf_counter()

    def on_iteration(state: State) -> None:
        limit = fit.problem.schedule.max_iterations
        lease.report(state.iteration / limit, f"iteration {state.iteration} of at most {limit}")

    state, _ = run_schedule(fit.problem, on_slot, on_iteration)
    finish = _finish(fit, state)

    def write(session: Session) -> None:
        session.execute(insert(Slot), rows)
        run = session.get_one(CalibrationRun, fit.run.id)
        run.schedule, run.iteration = to_document(state), state.iteration
        session.flush()
        finish(session)

    return write


def _finish(fit: Fit, state: State) -> Write:
    """Polish, baselines, deviations, and the errors on the pairs that were held out."""
    began = time.perf_counter()
    document = solve_finish(fit.problem, state)
    if fit.heldout.size:
        outside = evaluate(
            document["intrinsics"], document["transform"], fit.points[fit.heldout], fit.pixels[fit.heldout]
        )
        document["heldout"] = outside | {"indices": fit.heldout.tolist()}
    document["provenance"] = {
        "request": fit.run.problem,
        "pairs_sha256": pairs_sha256(fit.pairs),
        "sources_sha256": sources_sha256(),
    }
    document["finish_seconds"] = time.perf_counter() - began

    def write(session: Session) -> None:
        run = session.get_one(CalibrationRun, fit.run.id)
        session.add(
            Result(
                fleet_id=run.fleet_id,
                calibration_id=run.calibration_id,
                run_id=run.id,
                camera=run.camera,
                model=run.model,
                fold=run.fold,
                document=document,
            )
        )
        session.flush()
        end_run(session, run, "done")

    return write


def _slot_row(context: Context, fit: Fit, iteration: int, slot: int, outcome: SlotOutcome, seconds: float) -> Json:
    return {
        "run_id": fit.run.id,
        "iteration": iteration,
        "slot": slot,
        "loss": outcome.loss,
        "parameters": list(outcome.parameters),
        "evaluations": outcome.evaluations,
        "seconds": seconds,
        "worker": context.worker,
    }
