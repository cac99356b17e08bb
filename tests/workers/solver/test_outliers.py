from dataclasses import replace

import numpy as np
import pytest

from tests.workers.solver.rigs import PLAIN, real_correspondences, real_problem, simulated
from workers.geometry.models import DEFAULT_MODELS
from workers.solver import polish as polishing
from workers.solver.estimate import estimate
from workers.solver.outcomes import Outcome
from workers.solver.outliers import judge, leverage, without
from workers.solver.polish import polish


@pytest.mark.parametrize("model", DEFAULT_MODELS)
def test_gross_outliers_are_named_and_good_pairs_are_not(model):
    problem, truth = simulated(model, 60, **PLAIN)
    rng = np.random.default_rng(0)
    bad = np.sort(rng.choice(222, 22, replace=False))
    marks = problem.pixels.copy()
    around = rng.uniform(0, 2 * np.pi, 22)
    marks[bad] += rng.uniform(12, 300, 22)[:, None] * np.stack([np.cos(around), np.sin(around)], axis=1)
    spoiled = replace(problem, pixels=marks)
    plain = np.array(polish(spoiled, truth).parameters)
    found = judge(spoiled, plain).outliers
    named = {one.index for one in found}
    assert set(bad.tolist()) <= named
    assert len(named) <= 23
    assert [one.score for one in found] == sorted((one.score for one in found), reverse=True)
    assert all(one.residual_px > 5 and "standard deviations" in one.reason for one in found)
    left = polish(without(spoiled, found), plain).parameters
    clean = polish(without(problem, found), truth).parameters
    np.testing.assert_allclose(left, clean, rtol=1e-6, atol=1e-6)


def test_swapped_marks_and_points_behind_the_camera_are_called_that():
    problem, truth = simulated("pinhole", 61)
    marks, points = problem.pixels.copy(), problem.points.copy()
    far = int(np.argmax(np.hypot(*(marks - marks[3]).T)))
    marks[[3, far]] = marks[[far, 3]]
    points[7] = -points[7]
    reasons = {one.index: one.reason for one in judge(replace(problem, pixels=marks, points=points), truth).outliers}
    assert set(reasons) == {3, 7, far}
    assert f"pair {far} look swapped" in reasons[3]
    assert "behind the camera" in reasons[7]


def test_clean_walks_name_nobody():
    named = [
        len(judge(problem, truth).outliers)
        for problem, truth in (simulated("pinhole", seed) for seed in range(62, 72))
    ]
    assert sum(named) <= 1


def test_a_shifted_pose_of_the_real_board_is_named():
    points, _, poses = real_correspondences()
    rng, problem = np.random.default_rng(0), real_problem("kannala_brandt", locked=PUBLISHED)
    start = np.array(polish(problem, 0.5 * (problem.lower + problem.upper)).parameters)
    before = {int(poses[one.index]) for one in judge(problem, start).outliers}
    hits = 0
    for pose in np.unique(poses):
        shift = rng.normal(size=3)
        moved = points + np.where(poses == pose, 1.0, 0.0)[:, None] * 0.086 * shift / np.linalg.norm(shift)
        named = {int(poses[one.index]) for one in judge(replace(problem, points=moved), start).outliers}
        hits += int(pose) in named
        assert len(named - before - {int(pose)}) <= 2
    assert hits >= 19


PUBLISHED = {
    "f_x": 1176.93, "f_y": 1177.72, "c_x": 962.275, "c_y": 612.725,
    "k1": -0.0540096, "k2": -0.0784275, "k3": 0.0959641, "k4": -0.0515253,
}  # fmt: skip


def test_leverage_is_the_same_in_any_units():
    rows = np.random.default_rng(0).normal(size=(40, 5))
    units = np.array([1.0, 1e3, 1.0, 1e-4, 1e-7])
    plain = leverage(rows, rows.reshape(20, 2, 5))
    np.testing.assert_allclose(leverage(rows * units, (rows * units).reshape(20, 2, 5)), plain, rtol=1e-9, atol=1e-12)
    assert np.trace(plain.sum(axis=0)) == pytest.approx(5.0)


def test_a_fit_that_runs_out_of_steps_says_so_and_is_no_result(monkeypatch):
    problem, truth = simulated("brown_conrady", 3)
    assert estimate(problem, truth).outcome.converged
    monkeypatch.setattr(polishing, "MAX_EVALUATIONS", 2)
    far = 0.5 * (problem.lower + problem.upper)
    assert judge(problem, far).fit.outcome is Outcome.OUT_OF_STEPS
    found = estimate(problem, far)
    assert found.outcome is Outcome.OUT_OF_STEPS
    assert "ran out" in found.outcome.sentence
