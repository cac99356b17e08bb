from dataclasses import replace

import numpy as np
import pytest

from tests.workers.solver.rigs import simulated
from workers.geometry.models import MODELS
from workers.solver.baselines import linear_baseline, linear_starts
from workers.solver.polish import cost_of, polish


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("seed", "wrong"), [(80, 0), (81, 0), (82, 74)])
def test_a_linear_start_reaches_the_optimum_at_any_mount_also_with_a_third_of_the_marks_anywhere(model, seed, wrong):
    loss = {"loss": "saturating"} if wrong else {}
    problem, truth = simulated(model, seed, mount_deg=100, rotation_range_deg=180, **loss)
    marks = problem.pixels.copy()
    marks[:wrong] = np.random.default_rng(0).uniform((0, 0), problem.image_size, (wrong, 2))
    spoiled = replace(problem, pixels=marks)
    fit, best = linear_baseline(spoiled), polish(spoiled, truth)
    assert fit is not None
    assert cost_of(spoiled, fit.parameters, best.scale_px) <= 1.001 * best.cost


def test_the_linear_camera_of_clean_marks_is_the_camera():
    problem, truth = simulated("pinhole", 83, noise_px=0.0)
    np.testing.assert_allclose(linear_starts(problem)[0], truth, rtol=1e-5, atol=1e-5)


def test_the_same_seed_draws_the_same_samples():
    problem, _ = simulated("kannala_brandt", 84)
    first, second = (linear_starts(problem) for _ in range(2))
    assert all((a == b).all() for a, b in zip(first, second, strict=True))


def test_too_few_pairs_have_no_linear_camera():
    problem, truth = simulated("pinhole", 85, pairs=12)
    locks = dict(zip(problem.names[2:], truth[2:].tolist(), strict=True))
    few, _ = simulated("pinhole", 85, pairs=12, locked=locks)
    weights = np.where(np.arange(12) < 5, 1.0, 0.0)
    assert linear_baseline(replace(few, weights=weights)) is None
