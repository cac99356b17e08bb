import json
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.workers.solver.rigs import simulated
from workers.solver.narrowing import advance, bounds_of, from_document, run_search, start, to_document
from workers.solver.outcomes import SolveError
from workers.solver.polish import polish
from workers.solver.slot import SlotOutcome, run_slot

SHORT = {"slots": 4, "population": 160, "generations": 8, "max_iterations": 5}
PROBLEM, _ = simulated("pinhole", 2, schedule=SHORT)
# Algorithm 2: its slots need not agree.
PROBLEM = replace(PROBLEM, schedule=replace(PROBLEM.schedule, agreeing=0))


def outcomes_of(losses):
    centre = 0.5 * (PROBLEM.lower + PROBLEM.upper)
    return [SlotOutcome(loss, tuple((centre + i).tolist()), 10) for i, loss in enumerate(losses)]


def test_one_go_is_the_same_as_stepping_slots_in_any_order_through_json():
    iterations = defaultdict(list)
    whole = run_search(PROBLEM, lambda iteration, slot, outcome: iterations[iteration].append(outcome))
    rng, state = np.random.default_rng(0), start(PROBLEM)
    while state.stopped is None:
        state = from_document(json.loads(json.dumps(to_document(state), allow_nan=False)))
        lower, upper = bounds_of(PROBLEM, state)
        found = {}
        for slot in rng.permutation(PROBLEM.schedule.slots):
            sent = json.loads(json.dumps([lower.tolist(), upper.tolist()]))
            found[int(slot)] = run_slot(PROBLEM, sent[0], sent[1], state.iteration, int(slot))
        in_order = [found[slot] for slot in sorted(found)]
        assert in_order == iterations[state.iteration]
        state = advance(PROBLEM, state, in_order)
    assert state == whole
    assert state.evaluations == sum(o.evaluations for outcomes in iterations.values() for o in outcomes)


@settings(deadline=None)
@given(st.lists(st.lists(st.floats(0.5, 100.0), min_size=4, max_size=4), min_size=1, max_size=8))
def test_the_loss_never_rises_and_ties_go_to_the_lowest_slot(iterations):
    state = start(PROBLEM)
    for losses in iterations:
        if state.stopped:
            break
        before = state
        state = advance(PROBLEM, state, outcomes_of(losses))
        assert state.best_loss == min(before.best_loss, *losses)
        if min(losses) < before.best_loss:
            assert state.best_parameters == outcomes_of(losses)[losses.index(min(losses))].parameters
        else:
            assert state.best_parameters == before.best_parameters
    assert state.iteration <= PROBLEM.schedule.max_iterations
    assert from_document(json.loads(json.dumps(to_document(state)))) == state


def test_the_box_narrows_about_the_best_and_stays_inside():
    state = advance(PROBLEM, start(PROBLEM), outcomes_of([5, 4, 6, 7]))
    corner = replace(state, best_parameters=tuple(PROBLEM.upper.tolist()))
    lower, upper = bounds_of(PROBLEM, corner)
    np.testing.assert_array_equal(upper, PROBLEM.upper)
    np.testing.assert_allclose(upper - lower, 0.7 * 0.5 * (PROBLEM.upper - PROBLEM.lower))


def test_stop_rules():
    def run(losses_per_iteration, **schedule):
        problem = replace(PROBLEM, schedule=replace(PROBLEM.schedule, **schedule))
        state = start(problem)
        for loss in losses_per_iteration:
            if state.stopped is None:
                state = advance(problem, state, outcomes_of([loss] * 4))
        return state.stopped, state.iteration

    assert run([3, 2, 1.5, 1], goal_px=1.6) == ("goal", 3)
    assert run([3, 2, 2, 2, 1.9999, 1, 1], patience=3, max_iterations=60) == ("converged", 5)
    assert run([3, 2, 1, 0.5, 0.25, 0.1], patience=3) == ("iterations", 5)
    # A relative decrease above the tolerance starts the patience again.
    assert run([3, 3, 3, 2.99, 2.99, 2.99], patience=3, max_iterations=6) == ("iterations", 6)


def test_slots_agree_on_the_lowest_loss_alone():
    problem = replace(PROBLEM, schedule=replace(PROBLEM.schedule, slots=2, agreeing=2, patience=9, max_iterations=9))

    def run(*iterations):
        state = start(problem)
        for losses in iterations:
            state = advance(problem, state, outcomes_of(losses))
        return state.stopped, state.agreeing

    assert run([3.0, 3.0001]) == ("agreed", 2)
    assert run([3.0, 2.0]) == (None, 1)
    assert run([3.0, 2.0], [4.0, 2.0]) == ("agreed", 2)
    assert run([3.0, 2.0], [2.0, 1.0]) == (None, 1)  # two ended at 2, which is not the lowest
    assert run([0.0, 1e-9]) == ("agreed", 2)


def test_by_default_two_polished_slots_are_enough():
    for seed in range(3):
        problem, truth = simulated("brown_conrady", 70 + seed, mount_deg=100, rotation_range_deg=180)
        slots = []
        state = run_search(problem, lambda iteration, slot, outcome, slots=slots: slots.append(slot))
        assert (slots, state.stopped, state.iteration) == ([0, 1], "agreed", 1)
        assert polish(problem, state.best_parameters).cost < 1.001 * polish(problem, truth).cost


def test_slots_must_all_report():
    with pytest.raises(SolveError):
        advance(PROBLEM, start(PROBLEM), outcomes_of([1, 2, 3]))
    stopped = replace(advance(PROBLEM, start(PROBLEM), outcomes_of([1, 2, 3, 4])), stopped="goal")
    with pytest.raises(SolveError):
        advance(PROBLEM, stopped, outcomes_of([1, 2, 3, 4]))


def test_progress_is_reported():
    slots, states = [], []
    state = run_search(PROBLEM, lambda iteration, slot, outcome: slots.append((iteration, slot)), states.append)
    assert slots == [(iteration, slot) for iteration in range(state.iteration) for slot in range(4)]
    assert state == states[-1] and [each.iteration for each in states] == [*range(1, state.iteration + 1)]
