"""Fits of disjoint halves against the deviations that the full fit states, computed again with NumPy."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from apexcal.documents.results import FitResult
from tests.workers.solver.draws import few_or_many
from tests.workers.solver.rigs import PLAIN, real_correspondences, real_problem
from tests.workers.solver.walks import Recomputed, finish, posed, walked
from workers.solver.blocks import blocks_of
from workers.solver.estimate import estimate
from workers.solver.halves import _ratios, halves_of, too_small
from workers.solver.polish import polish


def recomputed(document, again, first):
    """(ratio over the parameters, over the marks): linear fits of both halves, plain NumPy."""
    rows = [np.repeat(half, 2) for half in (first, ~first)]
    inverses = [np.linalg.inv(again.J[half].T @ again.J[half]) for half in rows]
    steps = [-Q @ again.J[half].T @ again.residuals[half] for Q, half in zip(inverses, rows, strict=True)]
    apart = steps[0] - steps[1]
    stated = document["sigma_px"] ** 2 * (inverses[0] + inverses[1])
    scale = np.sqrt(np.diag(stated))
    ratio = np.sqrt((apart / scale) @ np.linalg.solve(stated / np.outer(scale, scale), apart / scale) / len(apart))
    of_pixels = np.sum((again.J @ stated) * again.J, axis=1)
    return ratio, np.sqrt(np.mean((again.J @ apart) ** 2 / of_pixels))


def test_halves_of_a_walk_are_those_of_its_stretches():
    problem, truth = walked(31, **PLAIN)
    document = finish(problem, truth)
    again = Recomputed(document, problem.points, problem.pixels)
    labels = problem.blocks.labels
    for one, first in zip(document["halves"], (labels % 2 == 0, labels < 4), strict=True):
        ratio, of_marks = recomputed(document, again, first)
        assert one["pairs"] == [int(first.sum()), int((~first).sum())]
        assert one["ratio"] == pytest.approx(ratio, rel=1e-3)
        assert one["field_ratio"] == pytest.approx(of_marks, rel=1e-3)
        freedom = 2 * len(labels) - 10
        assert one["limit"] == pytest.approx(np.sqrt(stats.f.ppf(0.999, 10, freedom)), rel=1e-3)
        # What people read is of the fits themselves.
        fits = [
            np.array(polish(replace(problem, weights=half.astype(float)), truth).parameters)
            for half in (first, ~first)
        ]
        assert one["translation_mm"] == pytest.approx(1e3 * np.linalg.norm(fits[0][3:6] - fits[1][3:6]), rel=1e-3)
        assert one["holds"]
    FitResult.model_validate(document)


def test_a_variance_that_is_lost_in_rounding_leaves_the_ratios_numbers():
    """A board that stood in two places: along one direction the computed variance is below zero."""
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    covariance = axes @ np.diag([1e4, 1.0, -1e-10]) @ axes.T
    difference = axes @ [100.0, 1.0, 0.0], covariance, [covariance]
    errors = SimpleNamespace(difference=lambda *halves: difference, freedom_of=lambda grows: 10.0)
    used = np.ones(3, np.bool_)
    (parameters, marks), stated = _ratios(errors, axes.T, used, used)
    assert parameters.ratio == pytest.approx(1.0) and parameters.directions == 2.0
    assert stated[:2] == pytest.approx([1e4, 1.0]) and (stated >= 0.0).all() and np.isfinite(marks).all()


def _sentences(problem, truth):
    return too_small(halves_of(estimate(problem, truth)), problem)


def test_a_camera_that_turned_on_the_way_is_named():
    named = [_sentences(*walked(40 + seed, turned_deg=0.15)) for seed in range(8)]
    assert sum(any("The camera turned by 0.1" in one for one in sentences) for sentences in named) >= 7
    document = finish(*walked(40, turned_deg=0.15))
    assert document["prediction"]["expected_over_stated"] >= 1.0


@few_or_many(12, 25)
@pytest.mark.parametrize("made", [walked, posed])
def test_sound_halves_differ_by_what_is_stated(made, draws):
    found = [halves_of(estimate(*made(700 + seed))) for seed in range(draws)]
    for split in (0, 1):
        assert 0.8 < np.median([halves[split].ratio for halves in found]) < 1.2
    assert np.mean([all(one.holds for one in halves) for halves in found]) >= 0.92


def _correlated(seed, pairs=8, shift_px=0.5):
    """A sound mount, and marks whose errors are shared by so many pairs in a row."""
    problem, truth = walked(seed)
    rng = np.random.default_rng((seed, 3))
    count = len(problem.pixels)
    shifts = shift_px * rng.normal(size=(count // pairs + 1, 2))
    return replace(problem, pixels=problem.pixels + shifts[np.arange(count) // pairs]), truth


@few_or_many(20, 60)
def test_neighbours_that_err_together_are_no_reason_for_doubt(draws):
    """Asked: one in twenty. Sixty walks have five objections or more in fewer than one of five such tests at 0.05."""
    found = [halves_of(estimate(*_correlated(1200 + seed))) for seed in range(draws)]
    assert np.mean([not all(one.holds for one in halves) for halves in found]) <= 0.07


def test_limits_allow_for_what_stretches_may_share_without_counting():
    """A limit is Fisher's for the errors with what stretches share, in units of what is stated without it."""
    found = next(
        found
        for found in (estimate(*_correlated(1300 + seed, shift_px=0.25)) for seed in range(20))
        if found.shared is not None and 0.5 < found.shared.evidence < 2.7
    )
    assert found.errors is found.plain and found.wider is not None
    plain = halves_of(replace(found, wider=None))
    for one, alone, first in zip(halves_of(found), plain, found.holding.blocks.halves, strict=True):
        assert (one.ratio, one.field_ratio) == (alone.ratio, alone.field_ratio)
        assert one.limit > 1.05 * alone.limit
        step, covariance, parts = found.wider.difference(first, ~first)
        scale = 1.0 / found.wider.scale
        covariance = covariance * np.outer(scale, scale)
        wide = np.sqrt((step * scale) @ np.linalg.solve(covariance, step * scale) / len(step))
        grows = np.array([np.trace(np.linalg.solve(covariance, part * np.outer(scale, scale))) for part in parts])
        grows /= len(step)
        freedom = 2.0 / (grows @ found.wider.unsure @ grows)
        limit = np.sqrt(stats.f.ppf(0.999, len(step), freedom))
        assert one.limit / one.ratio == pytest.approx(limit / wide, rel=1e-4)


def test_folds_have_no_halves():
    problem, truth = walked(31, **PLAIN)
    document = finish(replace(problem, fold=2), truth)
    assert (document["halves"], document["prediction"]) == ([], None)


def test_the_prediction_is_the_covariance_at_the_pixels():
    problem, truth = walked(33)
    document = finish(problem, truth)
    again = Recomputed(document, problem.points, problem.pixels)
    prediction = document["prediction"]
    assert (prediction["distances_m"], len(prediction["points"])) == ([5.0, 20.0, 50.0], 15)
    for point in prediction["points"][::4]:
        ray = np.array(
            [(point["u"] - again.lens[2]) / again.lens[0], (point["v"] - again.lens[3]) / again.lens[1], 1.0]
        )
        for place, distance in enumerate(prediction["distances_m"]):
            seen = ray / np.linalg.norm(ray) * distance
            lidar = (again.R.T @ (seen - again.t))[None]
            J = again.derivative(lambda x, lidar=lidar: again.project(x, lidar), 10)
            C = J @ again.covariance @ J.T
            assert point["stated_px"][place] == pytest.approx(np.sqrt(np.trace(C)), rel=1e-3)
            B = again.derivative(lambda d, lidar=lidar: again.project(np.zeros(10), lidar + d), 3)
            back = np.linalg.pinv(B)
            assert point["stated_mm"][place] == pytest.approx(1e3 * np.sqrt(np.trace(back @ C @ back.T)), rel=1e-3)
    assert prediction["expected_over_stated"] == 1.0


def test_odd_and_even_poses_of_the_real_board_differ_by_what_is_stated():
    _, _, poses = real_correspondences()
    bare = real_problem("kannala_brandt")
    problem = replace(bare, blocks=blocks_of({"x": poses, "group": poses.tolist()}))
    start = np.array(polish(bare, 0.5 * (bare.lower + bare.upper)).parameters)
    found, alone = estimate(problem, start), estimate(bare, start)
    assert found.shared is not None and found.shared.counted and found.shared.evidence > 1.0
    assert halves_of(found)[0].ratio < 1.6
    assert np.all(found.spread.std > 0.9 * alone.spread.std)
