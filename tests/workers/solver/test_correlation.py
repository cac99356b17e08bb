"""What groups share and what lasts: the corners of a sweep err together, and so may sweeps near in time."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.precision import Halves
from tests.workers.solver.walks import CORNERS, finish, walked
from workers.solver.blocks import STRETCHES, blocks_of
from workers.solver.correlation import Component, Linearised, shares_of
from workers.solver.error_model import linearised
from workers.solver.estimate import estimate
from workers.solver.halves import too_small
from workers.solver.residuals import predict
from workers.solver.shared_errors import shared_errors
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


def test_many_groups_have_moments_and_few_have_not():
    stamps = np.random.default_rng(0).permutation(60)
    rows = {"x": [0.0] * 120, "stamp_ns": np.repeat(stamps, 2).tolist(), "group": np.repeat(stamps, 2).tolist()}
    found = blocks_of(rows)
    assert (found.kind, found.labels.max(), found.over_time) == ("group", 59, True)
    np.testing.assert_allclose(found.moments[::2], 1e-9 * stamps)
    np.testing.assert_array_equal(found.moments[::2], found.moments[1::2])
    first = found.halves[1]
    assert np.all(stamps[first[::2]] < 30) and first.sum() == 60
    few = blocks_of({name: values[:78] for name, values in rows.items()})
    assert (few.labels.max(), few.moments, few.over_time) == (38, None, False)
    without = blocks_of({"x": [0.0] * 120, "group": np.repeat(np.arange(60), 2).tolist()})
    assert np.all(np.diff(without.moments) >= 0)


def dense(component):
    """(2 N, 2 N) of a component at a variance of one."""
    same = np.equal.outer(component.labels, component.labels)
    K = same * np.exp(-np.abs(np.subtract.outer(component.moments, component.moments)) / component.lasts)
    U = component.shapes.reshape(-1, component.shapes.shape[2])
    return np.kron(K, np.ones((2, 2))) * (U @ U.T)


def test_the_likelihood_the_products_and_the_curvature_are_those_of_the_dense_covariance():
    random = np.random.default_rng(4)
    n, labels = 40, random.permutation(np.arange(40) // 3)
    moments = 0.7 * labels
    groups = Component(random.normal(size=(n, 2, 3)), labels, moments)
    lasting = Component(random.normal(size=(n, 2, 2)), np.zeros(n, np.int64), moments, 1.7)
    J, rows = random.normal(size=(n, 2, 3)), random.normal(size=(n, 2, 4))
    J[5] = 0.0  # this pair does not count
    alike = [each.shapes @ random.normal(size=(14, each.shapes.shape[2], 1))[labels] for each in (groups, lasting)]
    residuals = random.normal(size=(n, 2)) + np.sum(alike, axis=0)[:, :, 0]
    residuals[5] = 0.0
    for component in (groups, lasting):
        flat = rows.reshape(2 * n, 4)
        np.testing.assert_allclose(component.product(rows), flat.T @ dense(component) @ flat, rtol=1e-10)
    fit = Linearised(residuals, J, np.diag([0.0, 0.5, 2.0]), np.array([0.0, 0.3, -0.1]))
    used = np.repeat(np.arange(n) != 5, 2)
    A, r = J.reshape(-1, 3)[used], residuals.ravel()[used]

    def unlikely(noise, variances, components):
        parts = zip(variances, components, strict=True)
        V = noise * np.eye(2 * n) + sum(variance * dense(each) for variance, each in parts)
        W = np.linalg.inv(V[np.ix_(used, used)])
        N, g = A.T @ W @ A + fit.prior, A.T @ W @ r + fit.pull
        return 0.5 * (np.linalg.slogdet(N)[1] - np.linalg.slogdet(W)[1] + r @ W @ r - g @ np.linalg.solve(N, g))

    found = shares_of(fit, (groups, lasting), 1.0)
    assert np.all(found.variances > 0.0)
    assert -found.likelihood == pytest.approx(unlikely(found.noise, found.variances, found.components), rel=1e-6)
    for factors in ((1.3, 1.0, 1.0), (0.8, 1.0, 1.0), (1.0, 1.5, 1.0), (1.0, 1.0, 1.5), (1.0, 0.7, 0.7)):
        here = unlikely(found.noise * factors[0], found.variances * factors[1:], found.components)
        assert here >= -found.likelihood - 1e-4


def test_the_covariance_is_that_of_noise_groups_and_what_lasts():
    problem, truth = walk_of_corners(5, stretch_px=1.5)
    found = estimate(problem, truth)
    named, errors = found.shared, found.errors
    assert named.over_time.counted and named.counted and errors is found.wider
    fit, scale = linearised(whitened(problem, found.held_at), found.held_at)
    J = fit.jacobian.reshape(-1, len(scale))
    parts = zip(errors.variances, errors.shared, strict=True)
    V = errors.noise * np.eye(len(J)) + sum(variance * dense(each) for variance, each in parts)
    Q = np.linalg.inv(J.T @ J)
    expected = (Q @ J.T @ V @ J @ Q) * np.outer(scale, scale)
    unit = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(errors.covariance() / np.outer(unit, unit), expected / np.outer(unit, unit), atol=2e-3)
    assert named.over_time.shift_px == pytest.approx(np.sqrt(errors.variances[-1]))
    assert 0.7 < named.over_time.shift_px < 3.0


def test_it_is_told_for_how_long_errors_last():
    random = np.random.default_rng(8)
    for seed, lasts in ((61, 4.0), (62, 1.2)):
        problem, truth = walked(seed)
        moments = problem.blocks.moments
        alike, keep = random.normal(size=(len(moments), 2)), np.exp(-np.diff(moments) / lasts)
        for i in range(1, len(moments)):
            alike[i] = keep[i - 1] * alike[i - 1] + np.sqrt(1.0 - keep[i - 1] ** 2) * alike[i]
        shared = estimate(replace(problem, pixels=problem.pixels + 1.5 * alike), truth).shared
        assert shared.counted and shared.deviations["shift_px"] == pytest.approx(1.5, rel=0.4)
        assert shared.blocks == pytest.approx(np.ptp(moments) / (2.0 * lasts), rel=0.6)


def test_a_walk_whose_second_half_is_turned_is_named_and_shifts_of_stretches_are_no_turn():
    problem, truth = walk_of_corners(7000, turned_deg=0.2)
    document = finish(problem, truth)
    halves = [Halves.model_validate(one) for one in document["halves"]]
    assert any("The camera turned by" in one for one in too_small(halves, problem))
    assert document["shared_errors"]["by"] == "group"
    said, told = [], []
    for seed in range(8):
        document = finish(*walk_of_corners(7100 + seed, stretch_px=1.0))
        said.append(not all(one["holds"] for one in document["halves"]))
        told.append(document["shared_errors"]["over_time"]["counted"])
    assert sum(said) <= 1 and sum(told) >= 6


def test_a_sound_walk_of_corners_keeps_the_covariance_of_its_groups():
    problem, truth = walk_of_corners(7001)
    alone = replace(problem, blocks=replace(problem.blocks, moments=None))
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
    assert shared.named.over_time.blocks >= 4 and np.isfinite(shared.wider.covariance()).all()
