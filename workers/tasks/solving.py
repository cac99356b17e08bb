"""A calibration run's work: a whole run, a bundle of slots, or the finish. Every way calls the same compiled slot."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any
from uuid import UUID

import numpy as np
from sqlalchemy import bindparam, insert, select
from sqlalchemy.orm import Session

from apexcal.documents.checks import doubts_of
from apexcal.documents.results import FitResult, Provenance
from apexcal.documents.states import UNENDED
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json, new_id
from service.platform.db.calibrations import FULL, CalibrationRun, Result, Slot
from service.platform.handovers import RunEnd, SlotBundle
from service.platform.jobs.claims import CancelledError, Claim, Lease
from workers.judge.fit_checks import checks_of_fit
from workers.solver.estimate import at_clock
from workers.solver.held_out import held_out
from workers.solver.narrowing import (
    SearchState,
    advance,
    bounds_of,
    from_document,
    run_search,
    start,
    to_document,
)
from workers.solver.outcomes import SolveError
from workers.solver.problem import FitProblem
from workers.solver.provenance import pairs_sha256, sources_sha256
from workers.solver.slot import SlotOutcome, run_slot
from workers.solver.solution import finished
from workers.tasks.concluding import LastRun, conclude_by
from workers.tasks.context import Context
from workers.tasks.run_inputs import RunInput, read_run

Write = Callable[[Session], object]

_RUN = select(
    *(CalibrationRun.id, CalibrationRun.fleet_id, CalibrationRun.calibration_id, CalibrationRun.set_id),
    *(CalibrationRun.camera, CalibrationRun.model, CalibrationRun.fold, CalibrationRun.state),
    *(CalibrationRun.fit_request, CalibrationRun.search_state),
).where(CalibrationRun.id == bindparam("run"))
_INSERT_SLOTS = insert(Slot)


def solve(context: Context, claim: Claim, lease: Lease) -> Write:
    """Do one part of a run: all of it, some slots of an iteration, or the finish."""
    with context.database.alone() as connection:
        run = connection.execute(_RUN, {"run": claim.subject_id}).one()
    if run.state not in UNENDED:
        raise CancelledError
    run_input = read_run(run.fit_request, run.fold, context.pairs_of(run.set_id), lease)
    part = claim.payload["part"]
    if part == "slots":
        return _slots(context, run_input, run.id, run.search_state, claim.payload)
    if part == "finish":
        return _finish(context, run_input, run, _state(run.search_state, run_input.problem), lease)
    return _whole(context, run_input, run, lease)


def _state(search: Json | None, problem: FitProblem) -> SearchState:
    """Return the state of the search after the iterations that are on record."""
    return from_document(search) if search else start(problem)


def _slots(context: Context, run_input: RunInput, run_id: UUID, search: Json | None, payload: Json) -> Write:
    """Some slots of the running iteration."""
    iteration = payload["iteration"]
    lower, upper = (bound.tolist() for bound in bounds_of(run_input.problem, _state(search, run_input.problem)))
    rows: list[Json] = []
    for slot in range(payload["first"], payload["stop"]):
        began = time.perf_counter()
        outcome = run_slot(run_input.problem, lower, upper, iteration, slot)
        rows.append(_slot_row(context, run_id, iteration, slot, outcome, time.perf_counter() - began))

    def narrow(search: Json | None, slots: Sequence[Slot]) -> tuple[Json, bool]:
        outcomes = [SlotOutcome(row.loss, tuple(row.parameters), row.evaluations) for row in slots]
        state = advance(run_input.problem, _state(search, run_input.problem), outcomes)
        return to_document(state), state.stopped is not None

    def write(session: Session) -> SlotBundle:
        session.connection().execute(_INSERT_SLOTS, rows)
        return SlotBundle(narrow)

    return write


def _whole(context: Context, run_input: RunInput, run: Any, lease: Lease) -> Write:
    """All iterations and the finish in one job."""
    rows: list[Json] = []
    began = time.perf_counter()

    def on_slot(iteration: int, slot: int, outcome: SlotOutcome) -> None:
        nonlocal began
        rows.append(_slot_row(context, run.id, iteration, slot, outcome, time.perf_counter() - began))
        began = time.perf_counter()

    def on_iteration(state: SearchState) -> None:
        limit = run_input.problem.schedule.max_iterations
        lease.report(state.iteration / limit, f"iteration {state.iteration} of at most {limit}")

    state = run_search(run_input.problem, on_slot, on_iteration)
    return _finish(context, run_input, run, state, lease, rows, (to_document(state), state.iteration))


def solved(run_input: RunInput, state: SearchState) -> FitResult:
    """Polish, baselines, deviations and checks; or the errors on the pairs that were held out."""
    estimate, result = finished(run_input.problem, state)
    if run_input.heldout:
        here, whole = (at_clock(problem, estimate.clock) for problem in (run_input.problem, run_input.whole))
        heldout = held_out(here, whole, run_input.heldout, estimate.parameters, result.outliers)
        return result.model_copy(update={"heldout": heldout})
    return result.model_copy(update={"checks": checks_of_fit(estimate, result, pairs=run_input.pairs)})


def _finish(
    context: Context,
    run_input: RunInput,
    run: Any,
    state: SearchState,
    lease: Lease,
    slots: Sequence[Json] = (),
    search: tuple[Json, int] | None = None,
) -> Write:
    """The end of a run: its result, with what it was made of, and after the last one the end of its calibration.

    ``slots`` that are not stored yet; ``search`` as :class:`RunEnd` has it.
    """
    began = time.perf_counter()
    fit = solved(run_input, state)
    of_job = {
        "provenance": Provenance(
            request=run_input.document, pairs_sha256=pairs_sha256(run_input.pairs), sources_sha256=sources_sha256()
        ),
        "finish_seconds": time.perf_counter() - began,
    }
    fit = fit.model_copy(update=of_job)
    row = {
        "id": new_id(),
        "fleet_id": run.fleet_id,
        "calibration_id": run.calibration_id,
        "run_id": run.id,
        "camera": run.camera,
        "model": run.model,
        "fold": run.fold,
        "fit": fit,
        # What is not set are the coefficients that a lens does not have.
        "document": fit.model_dump(mode="json", exclude_unset=True),
    }
    searches = [(run.id, context.worker, sum(slot["seconds"] for slot in slots))] if slots else []
    end = RunEnd(run, row, search, conclude_by(context, LastRun(run, Result(**row), searches), lease))

    def write(session: Session) -> RunEnd:
        if slots:
            session.connection().execute(_INSERT_SLOTS, slots)
        return end

    return write


def precision(context: Context, claim: Claim, lease: Lease) -> Write:
    """A fit to a camera's marks of now, of which the figures alone are stored."""
    with context.database.reading() as session:
        analysis = session.get_one(Analysis, claim.subject_id)
        question, pairs = analysis.asked, analysis.single_pairs or {}
    run_input = read_run(question["fit_request"], FULL, pairs, lease)
    state = run_search(run_input.problem)
    result = solved(run_input, state)
    middle = result.prediction and result.prediction.middle_at(20.0)
    answer: Json = {
        "answered": question["answered"],
        "pairs": result.pairs,
        "error_20m_mm": middle and middle[1],
        "doubts": [check.model_dump(mode="json") for check in doubts_of(result.checks)],
        "next_steps": result.next_steps and result.next_steps.model_dump(mode="json"),
    }
    return lambda session: answer


def _slot_row(
    context: Context, run_id: UUID, iteration: int, slot: int, outcome: SlotOutcome, seconds: float
) -> Json:
    if not np.isfinite((outcome.loss, *outcome.parameters)).all():
        raise SolveError(
            "non_finite",
            "No lens within the bounds gives these points a finite distance from their marks: the best of slot "
            f"{slot} in iteration {iteration} has the loss {outcome.loss}.",
            "Narrow the bounds of the distortion, or look for points that lie far out of the camera's view.",
        )
    return {
        "run_id": run_id,
        "iteration": iteration,
        "slot": slot,
        "loss": outcome.loss,
        "parameters": list(outcome.parameters),
        "evaluations": outcome.evaluations,
        "seconds": seconds,
        "worker": context.worker,
    }
