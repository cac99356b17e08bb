from dataclasses import replace

import numpy as np
import pytest

from tests.workers.solver.rigs import PLAIN, residual_pairs, simulated
from workers.geometry.models import DEFAULT_MODELS, MODELS, SEARCH_FORMS
from workers.solver.baselines import baseline
from workers.solver.outliers import judge
from workers.solver.polish import (
    SATURATION_SIGMAS,
    distances,
    mean_and_rms,
    polish,
    refine,
    robust_sigma_px,
    weighted_residuals,
)
from workers.solver.residuals import predict, residuals_and_jacobian, transform_of


@pytest.mark.parametrize("search", SEARCH_FORMS)
@pytest.mark.parametrize("model", MODELS)
def test_jacobian_is_the_derivative(model, search):
    problem, truth = simulated(model, 4, pairs=40, search=search)
    p = truth.copy()
    if search == "euler":
        p[:3] = np.radians([80, -75, 5])
    residuals, J = residuals_and_jacobian(problem, p)
    np.testing.assert_allclose(residuals.reshape(-1, 2), residual_pairs(problem, p), atol=1e-9)
    assert not predict(problem, p)[1].any()
    for j in range(len(p)):
        step = 1e-6 * np.eye(len(p))[j] * max(1.0, abs(p[j]) * 0.01)
        ahead, back = (residuals_and_jacobian(problem, p + s * step)[0] for s in (1, -1))
        np.testing.assert_allclose(J[:, j], (ahead - back) / (2 * step[j]), rtol=1e-4, atol=2e-4)


def test_the_transform_is_what_is_projected():
    for search in SEARCH_FORMS:
        problem, _ = simulated("pinhole", 4, search=search)
        p = problem.lower + 0.4 * (problem.upper - problem.lower)
        camera = transform_of(problem, p).apply(problem.points)
        expected = p[6:8] * camera[:, :2] / camera[:, 2:] + p[8:10]
        ahead = camera[:, 2] > 0.1
        assert ahead.any()
        np.testing.assert_allclose(predict(problem, p)[0][ahead], expected[ahead], rtol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_polish_is_stationary_and_below_the_truth(model):
    problem, truth = simulated(model, 6, **PLAIN)
    fit = polish(problem, truth)
    assert fit.outcome.converged
    assert fit.rms_px <= mean_and_rms(problem, truth)[1]
    residuals, J = weighted_residuals(problem, np.array(fit.parameters))
    cosines = np.abs(J.T @ residuals) / (np.linalg.norm(J, axis=0) * np.linalg.norm(residuals))
    assert cosines.max() < 1e-4


@pytest.mark.parametrize("model", DEFAULT_MODELS)
def test_plain_baseline_reaches_the_optimum_of_a_roughly_known_mount(model):
    for seed in range(4):
        problem, truth = simulated(model, seed)
        assert baseline(problem).rms_px == pytest.approx(polish(problem, truth).rms_px, rel=1e-4)


@pytest.mark.parametrize("loss", ["mean", "saturating"])
@pytest.mark.parametrize("model", DEFAULT_MODELS)
def test_a_fit_of_most_pairs_refines_to_the_minimum_of_all(model, loss):
    problem, truth = simulated(model, 7, loss=loss, outliers="keep")
    most = replace(problem, weights=np.where(np.arange(len(problem.points)) % 5, 1.0, 0.0))
    start = polish(most, truth)
    whole, near = polish(problem, truth), refine(problem, start.parameters)
    assert near.outcome.converged
    ends = [predict(problem, np.array(fit.parameters))[0] for fit in (start, near, whole)]
    # The scale of the robust loss settles to a thousandth.
    assert np.abs(ends[1] - ends[2]).max() < (1e-5 if loss == "mean" else 1e-2)
    assert np.abs(ends[0] - ends[2]).max() > 0.1


def test_a_refinement_stops_at_a_bound():
    problem, truth = simulated("pinhole", 7, **PLAIN)
    focal = polish(problem, truth).parameters[6]
    narrow = replace(problem, bounds=problem.bounds | {"f_x": (focal + 5.0, focal + 50.0)})
    near, whole = refine(narrow, truth), polish(narrow, truth)
    assert near.parameters[6] == pytest.approx(focal + 5.0, abs=1e-3)
    assert near.cost == pytest.approx(whole.cost, rel=1e-6)


def test_weights_leave_out_and_robust_polish_shrugs_off():
    problem, truth = simulated("pinhole", 8, **PLAIN)
    wrong = problem.pixels.copy()
    wrong[:40] += 150.0
    weights = np.where(np.arange(222) < 40, 0.0, 1.0)
    clean = polish(replace(problem, weights=weights), truth).parameters
    left_out = polish(replace(problem, pixels=wrong, weights=weights), truth).parameters
    np.testing.assert_allclose(left_out, clean, rtol=1e-6, atol=1e-6)
    plain = np.array(polish(replace(problem, pixels=wrong), truth).parameters)
    robust = np.array(polish(replace(problem, pixels=wrong, loss="saturating"), truth).parameters)
    assert np.abs(robust[6:] - truth[6:]).max() < 0.1 * np.abs(plain[6:] - truth[6:]).max()


def test_locks_and_priors_hold():
    problem, truth = simulated("pinhole", 9)
    free = polish(problem, truth).parameters[6]
    pulled, _ = simulated("pinhole", 9, priors={"f_x": {"mean": free + 50, "sigma": 0.5}})
    value = polish(pulled, truth).parameters[6]
    assert free + 10 < value < free + 50
    locked, _ = simulated("pinhole", 9, locked={"f_x": 700.0})
    assert polish(locked, truth).parameters[6] == 700.0


@pytest.mark.parametrize("model", DEFAULT_MODELS)
def test_with_most_marks_wrong_a_right_start_is_kept_and_the_wrong_are_named(model):
    spoiled, truth, bad = most_marks_wrong(model)
    right = polish(without_pairs(spoiled, bad), truth)
    for start in (truth, 0.5 * (spoiled.lower + spoiled.upper)):
        fit = polish(spoiled, start)
        near = np.delete(distances(spoiled, fit.parameters), bad)
        assert np.sqrt(np.mean(near**2)) < 1.1 * right.rms_px
        assert fit.scale_px <= spoiled.saturation_px
    named = {one.index for one in judge(spoiled, truth).outliers}
    assert len(set(bad.tolist()) - named) <= 2
    assert len(named - set(bad.tolist())) <= 1


def test_the_saturation_bounds_the_scale_of_the_saturating_loss_alone():
    spoiled, truth, _ = most_marks_wrong("pinhole")
    assert robust_sigma_px(spoiled, truth) <= spoiled.saturation_px / SATURATION_SIGMAS
    unbounded = replace(spoiled, saturation_px=np.inf)
    assert robust_sigma_px(unbounded, truth) > 10 * spoiled.saturation_px


def test_below_the_saturation_the_saturation_changes_no_bit():
    problem, truth = simulated("kannala_brandt", 10, loss="saturating")
    for start in (truth, 0.5 * (problem.lower + problem.upper)):
        assert polish(problem, start) == polish(replace(problem, saturation_px=np.inf), start)


def most_marks_wrong(model):
    """A problem with 60 % of the marks anywhere in the image, its true parameters, and the wrong pairs' indices."""
    problem, truth = simulated(model, 11, loss="saturating")
    rng, marks = np.random.default_rng(0), problem.pixels.copy()
    bad = rng.choice(222, 133, replace=False)
    marks[bad] = rng.uniform((0, 0), problem.image_size, (133, 2))
    return replace(problem, pixels=marks), truth, bad


def without_pairs(problem, bad):
    weights = np.ones(len(problem.points))
    weights[bad] = 0.0
    return replace(problem, weights=weights, loss="mean")
