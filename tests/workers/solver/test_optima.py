"""Problems with two optima are called that, whichever of them a search found; others are not."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.fit_requests import fit_request
from apexcal.documents.schedules import Schedule
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL
from tests.workers.solver.rigs import NOMINAL, PLAIN, SIZE, finish_plain, simulated
from workers.geometry.models import MODELS
from workers.geometry.projection import project
from workers.solver import polish as polishing
from workers.solver.narrowing import run_search, start
from workers.solver.optima import other_optima
from workers.solver.polish import mean_and_rms, polish, weighted_residuals
from workers.solver.problem import fit_problem

LENS = {"f_x": 700.0, "f_y": 700.0, "c_x": 640.0, "c_y": 480.0}


def small_board(seed, noise_px=3.0):
    """A flat board of 1.2 m, 8 m away, turned by 35 degrees: nearly the same picture as turned the other way.

    The two-fold ambiguity of planar poses under weak perspective (Schweighofer and Pinz 2006).
    """
    rng, tilt = np.random.default_rng(seed), np.radians(35.0)
    across, up = rng.uniform(-0.6, 0.6, (2, 40))
    points = np.stack([8.0 + across * np.sin(tilt), across * np.cos(tilt), up], axis=1)
    marks, _ = project("pinhole", np.array(list(LENS.values())), points @ FORWARD_LIDAR_TO_OPTICAL.T)
    request = {
        "model": "pinhole", "image_size": SIZE, "nominal": NOMINAL, "locked": LENS, "rotation_range_deg": 120.0,
        "bounds": dict.fromkeys(("t_x", "t_y", "t_z"), (-15.0, 15.0)), "seed": seed, **PLAIN,
    }  # fmt: skip
    return fit_problem(fit_request(**request), points, marks + noise_px * rng.normal(size=marks.shape))


def test_a_small_board_has_two_mounts_and_either_names_the_other():
    problem = small_board(0)
    state = run_search(problem)
    solution = finish_plain(problem, state)
    (sentence,) = [one for one in solution["several_optima"] if "fits nearly as well" in one]
    assert "turned by 68 degrees" in sentence
    deep = polish(problem, state.best_parameters)
    (other,) = other_optima(problem, deep, state.first_slot_parameters)
    assert deep.cost < other.cost < 1.25**2 * deep.cost
    (back,) = other_optima(problem, other, [deep.parameters, other.parameters])
    np.testing.assert_allclose(back.parameters, deep.parameters, atol=1e-4)


def test_nearly_as_deep_is_a_quarter_more():
    """Of the same marks with less and less noise the wrong mount stands out more: named up to a ratio of 1.25."""
    ratios = []
    problem = small_board(0)
    state = run_search(problem)
    starts = state.first_slot_parameters
    exact = small_board(0, noise_px=0.0).pixels
    for share in np.geomspace(0.4, 1.0, 19):
        quieter = replace(problem, pixels=exact + share * (problem.pixels - exact))
        ends = sorted((polish(quieter, start) for start in starts), key=lambda fit: fit.cost)
        deep = ends[0]
        other = next(fit for fit in ends if abs(fit.parameters[0] - deep.parameters[0]) > 0.5 or _turned(fit, deep))
        ratio = np.sqrt(other.cost / deep.cost)
        ratios.append(ratio)
        if abs(ratio - 1.25) > 0.01:
            assert bool(other_optima(quieter, deep, starts)) == (ratio < 1.25), ratio
    assert sum(1.1 < ratio < 1.24 for ratio in ratios) > 1 and sum(1.26 < ratio < 1.5 for ratio in ratios) > 1


def _turned(one, other):
    """Whether two fits are the two mounts of the ambiguity, turned by some 70 degrees, and not one."""
    return np.linalg.norm(np.subtract(one.parameters[:3], other.parameters[:3])) > 0.5


@pytest.mark.parametrize("model", MODELS)
def test_slots_that_stopped_short_in_one_basin_are_one_optimum(model):
    """Two slots that ended 6 per mille apart, on either side of the optimum along the flattest valley's floor."""
    problem, truth = simulated(model, 760, pairs=60, noise_px=4.7)
    polished = polish(problem, truth)
    best = np.array(polished.parameters)
    J = weighted_residuals(problem, best)[1]
    lengths = np.linalg.norm(J, axis=0)
    flattest = np.linalg.svd(J / lengths)[2][-1] / lengths
    ends = [_along(problem, best, side * flattest, 1.001 * polished.mean_px) for side in (1.0, -1.0)]
    losses = tuple(mean_and_rms(problem, end)[0] for end in ends)
    assert abs(losses[0] - losses[1]) < 0.006 * polished.mean_px
    assert other_optima(problem, polished, ends) == []
    assert other_optima(problem, polish(problem, ends[0]), [polished.parameters, ends[1]]) == []
    state = replace(start(problem), iteration=1, stopped="converged", history=losses[:1])
    state = replace(state, best_parameters=ends[0], best_loss=losses[0], first_slot_parameters=tuple(ends))
    assert finish_plain(problem, state)["several_optima"] == []


def _along(problem, best, direction, loss_px):
    """The end of a slot that stopped where its mean distance was that much, in that direction of the free ones."""
    reach, end = 1.0, best
    for _ in range(60):
        end = best.copy()
        end[problem.free] += reach * direction
        end = np.clip(end, problem.lower, problem.upper)
        if mean_and_rms(problem, end)[0] <= 1.002 * loss_px:
            break
        reach *= 0.7
    return tuple(end.tolist())


def test_an_end_that_is_no_minimum_is_no_optimum(monkeypatch):
    problem = replace(small_board(0), schedule=Schedule())  # its slots are not polished
    state = run_search(problem)
    deep = polish(problem, state.best_parameters)
    assert other_optima(problem, deep, state.first_slot_parameters)
    monkeypatch.setattr(polishing, "MAX_EVALUATIONS", 2)
    assert other_optima(problem, deep, state.first_slot_parameters) == []


def test_a_valley_is_one_place():
    problem, truth = simulated("pinhole", 5, pairs=40)
    far = replace(problem, points=np.tile(problem.points[:1], (40, 1)), pixels=np.tile(problem.pixels[:1], (40, 1)))
    starts = [tuple((truth * factor).tolist()) for factor in (0.9, 1.0, 1.1)]
    assert other_optima(far, polish(far, truth), starts) == []
