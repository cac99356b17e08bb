"""Walks with all corners: the corners of a sweep err together, and so may the sweeps of a stretch of the walk."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg

from apexcal.documents.precision import Halves
from tests.workers.solver.walks import CORNERS, finish, walked
from workers.solver.blocks import STRETCHES, blocks_of
from workers.solver.error_model import linearised
from workers.solver.estimate import estimate
from workers.solver.halves import too_small
from workers.solver.residuals import predict
from workers.solver.shared_errors import shared_errors
from workers.solver.stretches import _whitener
from workers.solver.variance_components import Variances
from workers.solver.weighting import whitened

SWEEPS = 100


def walk_of_corners(seed, turned_deg=0.0, stretch_px=0.0, sweeps=SWEEPS):
    """(problem, truth): four corners a sweep that err together by 10 mm and a degree; the camera turns halfway by so
    much, and the marks of each eighth of the walk are off by a common shift.
    """
    problem, truth = walked(seed)
    rng = np.random.default_rng((seed, 7))
    middles = problem.points[np.round(np.linspace(0, len(problem.points) - 1, sweeps)).astype(int)]
    points = (middles[:, None] + CORNERS).reshape(-1, 3)
    labels = np.repeat(np.arange(sweeps), 4)
    off, turn = 0.01 * rng.normal(size=(sweeps, 3)), np.radians(1.0) * rng.normal(size=(sweeps, 3))
    moved = points + off[labels] + np.cross(turn[labels], np.tile(CORNERS, (sweeps, 1)))
    n = len(points)
    here = replace(problem, points=moved, weights=np.ones(n), pixels=np.zeros((n, 2)), blocks=None)
    pixels, turned = predict(here, truth)[0], truth.copy()
    turned[1] += np.radians(turned_deg)
    pixels[n // 2 :] = predict(here, turned)[0][n // 2 :]
    pixels += stretch_px * rng.normal(size=(STRETCHES, 2))[np.arange(n) * STRETCHES // n]
    pixels += rng.normal(size=pixels.shape)
    blocks = blocks_of({"x": points[:, 0], "stamp_ns": labels * 400_000_000, "group": labels.tolist()})
    return replace(here, points=points, pixels=pixels, blocks=blocks), truth


def test_many_groups_are_in_stretches_of_time_and_few_are_not():
    stamps = np.random.default_rng(0).permutation(60)
    rows = {"x": [0.0] * 120, "stamp_ns": np.repeat(stamps, 2).tolist(), "group": np.repeat(stamps, 2).tolist()}
    found = blocks_of(rows)
    assert (found.kind, found.labels.max(), found.over_time) == ("group", 59, True)
    by_time = found.stretches[::2][np.argsort(stamps)]
    assert np.all(np.diff(by_time) >= 0) and set(np.bincount(by_time)) <= {7, 8}
    np.testing.assert_array_equal(found.stretches[::2], found.stretches[1::2])
    first = found.halves[1]
    assert np.all(stamps[first[::2]] < 30) and first.sum() == 60
    few = blocks_of({name: values[:78] for name, values in rows.items()})
    assert (few.labels.max(), few.stretches, few.over_time) == (38, None, False)
    without = blocks_of({"x": [0.0] * 120, "group": np.repeat(np.arange(60), 2).tolist()})
    assert np.all(np.diff(without.stretches) >= 0)


def test_groups_are_whitened_by_the_root_of_their_covariance():
    problem, truth = walk_of_corners(3)
    found = estimate(problem, truth)
    groups, variances = found.errors.shared[0], found.errors.variances
    within = Variances(np.array([found.errors.noise, *variances[:2]]), np.eye(3), np.ones(3, bool))
    whiten = _whitener(groups, within)
    U = groups.shapes[:4].reshape(8, 6)
    V = np.eye(8) + U @ np.diag(variances[groups.component] / found.errors.noise) @ U.T
    rows = np.zeros((len(problem.points), 2, 8))
    rows[:4] = np.eye(8).reshape(4, 2, 8)
    np.testing.assert_allclose(whiten(rows)[:4].reshape(8, 8), linalg.inv(linalg.sqrtm(V)), atol=1e-9)
    assert not whiten(rows)[4:].any()


def test_the_covariance_is_that_of_noise_groups_and_shifts():
    problem, truth = walk_of_corners(5, stretch_px=1.5)
    found = estimate(problem, truth)
    named, errors = found.shared, found.errors
    assert named.over_time.counted and named.counted and errors is found.wider
    here = whitened(problem, found.held_at)
    fit, scale = linearised(here, found.held_at)
    J = fit.jacobian.reshape(-1, len(scale))
    V = errors.noise * np.eye(len(J))
    offset, turn, shift = errors.variances
    groups = errors.shared[0]
    same = np.equal.outer(np.repeat(groups.labels, 2), np.repeat(groups.labels, 2))
    for variance, columns in ((offset, groups.component == 0), (turn, groups.component == 1)):
        U = groups.shapes[:, :, columns].reshape(len(J), -1)
        V += variance * same * (U @ U.T)
    stretch = np.repeat(problem.blocks.stretches, 2)
    V += shift * np.equal.outer(stretch, stretch) * np.tile(np.eye(2), (len(J) // 2, len(J) // 2))
    Q = np.linalg.inv(J.T @ J)
    expected = (Q @ J.T @ V @ J @ Q) * np.outer(scale, scale)
    unit = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(errors.covariance() / np.outer(unit, unit), expected / np.outer(unit, unit), atol=2e-3)
    assert named.over_time.shift_px == pytest.approx(np.sqrt(shift)) and 0.7 < named.over_time.shift_px < 3.0


def test_a_walk_whose_second_half_is_turned_is_named_and_shifts_of_stretches_are_no_turn():
    problem, truth = walk_of_corners(7000, turned_deg=0.2)
    document = finish(problem, truth)
    halves = [Halves.model_validate(one) for one in document["halves"]]
    assert any("the stretches of the walk the camera turned" in one for one in too_small(halves, problem))
    assert document["shared_errors"]["by"] == "group"
    said, told = [], []
    for seed in range(8):
        document = finish(*walk_of_corners(7100 + seed, stretch_px=1.0))
        said.append(not all(one["holds"] for one in document["halves"]))
        told.append(document["shared_errors"]["over_time"]["counted"])
    assert sum(said) <= 1 and sum(told) >= 6


def test_a_sound_walk_of_corners_keeps_the_covariance_of_its_groups():
    problem, truth = walk_of_corners(7001)
    alone = replace(problem, blocks=replace(problem.blocks, stretches=None))
    document, of_groups = finish(problem, truth), finish(alone, truth)
    assert not document["shared_errors"].pop("over_time")["counted"]
    assert of_groups["shared_errors"].pop("over_time") is None
    for name in ("std", "interval95_half_width", "covariance", "shared_errors"):
        assert document[name] == of_groups[name]
    assert all(one["holds"] for one in document["halves"])


def test_a_walk_without_its_groups_outliers_still_has_its_stretches():
    problem, truth = walk_of_corners(7002, stretch_px=1.5)
    weights = problem.weights.copy()
    weights[:40:3] = 0.0
    here = whitened(replace(problem, weights=weights), truth)
    found = estimate(problem, truth)
    shared = shared_errors(here, truth, replace(found.plain, fit=linearised(here, truth)[0]))
    assert shared.named.over_time.blocks == STRETCHES and np.isfinite(shared.wider.covariance()).all()
