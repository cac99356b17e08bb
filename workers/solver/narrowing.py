"""Algorithm 2: the narrowing of the search as a pure state machine that survives JSON."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from apexcal.documents.results import Stopped
from apexcal.geometry.rotations import shortest_vector
from workers.solver.optima import MOST_SLOTS
from workers.solver.outcomes import SolveError
from workers.solver.problem import FitProblem
from workers.solver.slot import SlotOutcome, run_slot

_EXACT_PX: Final = 1e-6  # losses of computed pairs differ by rounding


@dataclass(frozen=True)
class SearchState:
    """The state of a run between two iterations.

    iteration: how many are done. best_loss (px, infinite before the first) never rises. half_width: the box's
    half-widths before clipping to the initial bounds. stalled: iterations since the last relative decrease above
    the tolerance. first_slot_parameters: the bests of the first slots of the first iteration, which looked
    everywhere. history: best_loss after each iteration. agreeing: slots that ended at best_loss.
    """

    iteration: int
    best_loss: float
    best_parameters: tuple[float, ...]
    half_width: tuple[float, ...]
    stalled: int
    evaluations: int
    history: tuple[float, ...]
    stopped: Stopped | None
    first_slot_parameters: tuple[tuple[float, ...], ...] = ()
    agreeing: int = 0


_STATE: Final = TypeAdapter(SearchState)


def start(problem: FitProblem) -> SearchState:
    """The state before the first iteration."""
    lower, upper = problem.lower, problem.upper
    return SearchState(
        iteration=0,
        best_loss=float("inf"),
        best_parameters=(),
        half_width=tuple((0.5 * (upper - lower)).tolist()),
        stalled=0,
        evaluations=0,
        history=(),
        stopped=None,
    )


def bounds_of(problem: FitProblem, state: SearchState) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(lower, upper) for the next iteration, vectors in the order of `problem.names`."""
    lower, upper = problem.lower, problem.upper
    if state.iteration == 0:
        return lower, upper
    centre, half = np.array(state.best_parameters), np.array(state.half_width)
    if problem.any_rotation:
        # Past half a turn the rotations only repeat: a wall there would cut the box in two.
        centre[:3] = shortest_vector(centre[:3])
        lower[:3], upper[:3] = -np.inf, np.inf
    return np.maximum(lower, centre - half), np.minimum(upper, centre + half)


def advance(problem: FitProblem, state: SearchState, outcomes: Sequence[SlotOutcome]) -> SearchState:
    """The state after an iteration, from the outcomes of all its slots in slot order; ties go to the lowest slot."""
    schedule = problem.schedule
    if len(outcomes) != schedule.slots:
        raise SolveError(
            "bad_schedule", f"{len(outcomes)} outcomes for {schedule.slots} slots.", "Every slot reports once."
        )
    if state.stopped is not None:
        raise SolveError("bad_schedule", f"The run has already stopped ({state.stopped}).", "")
    best_loss, best_parameters = state.best_loss, state.best_parameters
    for outcome in outcomes:
        if outcome.loss < best_loss or not best_parameters:
            best_loss, best_parameters = outcome.loss, outcome.parameters
    losses = [state.best_loss] * state.agreeing + [outcome.loss for outcome in outcomes]
    decreased = state.iteration == 0 or state.best_loss - best_loss > schedule.tolerance * abs(state.best_loss)
    return _stop(
        problem,
        replace(
            state,
            iteration=state.iteration + 1,
            best_loss=best_loss,
            best_parameters=best_parameters,
            half_width=tuple(schedule.scale * half for half in state.half_width),
            stalled=0 if decreased else state.stalled + 1,
            evaluations=state.evaluations + sum(outcome.evaluations for outcome in outcomes),
            first_slot_parameters=state.first_slot_parameters
            or tuple(outcome.parameters for outcome in outcomes[:MOST_SLOTS]),
            history=(*state.history, best_loss),
            agreeing=sum(loss - best_loss <= schedule.tolerance * abs(best_loss) + _EXACT_PX for loss in losses),
        ),
    )


def _stop(problem: FitProblem, state: SearchState) -> SearchState:
    schedule = problem.schedule
    reason: Stopped | None = None
    if schedule.goal_px is not None and state.best_loss <= schedule.goal_px:
        reason = "goal"
    elif 0 < schedule.agreeing <= state.agreeing:
        reason = "agreed"
    elif state.stalled >= schedule.patience:
        reason = "converged"
    elif state.iteration >= schedule.max_iterations:
        reason = "iterations"
    return replace(state, stopped=reason)


def to_document(state: SearchState) -> dict[str, Any]:
    """JSON form. Floats survive it exactly; the infinite loss before the first iteration is null."""
    return asdict(state) | {"best_loss": state.best_loss if state.iteration else None}


def from_document(document: Mapping[str, Any]) -> SearchState:
    """The state of its JSON form."""
    loss = float("inf") if document["best_loss"] is None else document["best_loss"]
    return _STATE.validate_python({**document, "best_loss": loss})


def run_search(
    problem: FitProblem,
    on_slot: Callable[[int, int, SlotOutcome], None] | None = None,
    on_iteration: Callable[[SearchState], None] | None = None,
) -> SearchState:
    """The whole run in one go, through the same functions as a farmed one.

    on_slot(iteration, slot, outcome) and on_iteration(state) report progress.
    """
    state = start(problem)
    while state.stopped is None:
        lower, upper = bounds_of(problem, state)
        outcomes: list[SlotOutcome] = []
        for slot in range(problem.schedule.slots):
            outcomes.append(run_slot(problem, lower.tolist(), upper.tolist(), state.iteration, slot))
            if on_slot is not None:
                on_slot(state.iteration, slot, outcomes[-1])
        state = advance(problem, state, outcomes)
        if on_iteration is not None:
            on_iteration(state)
    return state
