"""Errors that pairs share, and the deviations that include them, computed again with NumPy from the result."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize, stats

from apexcal.documents.errors import DocumentError
from apexcal.geometry.rotations import rotation_from_vector, vector_from_rotation
from tests.workers.solver.draws import few_or_many
from tests.workers.solver.rigs import simulated
from tests.workers.solver.walks import Recomputed, finish, posed, walked
from workers.solver.blocks import blocks_of
from workers.solver.estimate import at_clock, estimate
from workers.solver.outcomes import SolveError
from workers.solver.polish import distances
from workers.solver.residuals import predict


def turned_about_middles(points, labels):
    """x (6,) -> points moved by an offset, and turned about the middle of their pose."""
    middles = np.stack([points[labels == label].mean(axis=0) for label in labels])

    def moves(x):
        return np.zeros(6) if x is None else points + x[:3] + np.cross(x[3:], points - middles)

    return moves


def shared_matrices(again, labels):
    """(2 N, 2 N) of each component at a variance of one, of blocks that share an offset and a turn."""
    U = again.by_pairs(turned_about_middles(again.points, labels))
    same = np.repeat(labels, 2)[:, None] == np.repeat(labels, 2)
    return [same * (U[:, :3] @ U[:, :3].T), same * (U[:, 3:] @ U[:, 3:].T)]


def restricted_likelihood(again, matrices, variances):
    V = sum(v * M for v, M in zip(variances, [np.eye(len(again.J)), *matrices], strict=True))
    A = again.J / np.linalg.norm(again.J, axis=0)
    W = np.linalg.inv(V)
    left = again.residuals - A @ np.linalg.solve(A.T @ W @ A, A.T @ W @ again.residuals)
    return -0.5 * (np.linalg.slogdet(V)[1] + np.linalg.slogdet(A.T @ W @ A)[1] + left @ W @ left)


@pytest.fixture(scope="module")
def of_poses():
    problem, truth = posed(11, poses=16, offset_m=0.01, turn_deg=1.5)
    document = finish(problem, truth)
    return problem, document, Recomputed(document, problem.points, problem.pixels)


def test_the_covariance_is_that_of_noise_offsets_and_turns(of_poses):
    problem, document, again = of_poses
    shared = document["shared_errors"]
    assert (shared["blocks"], shared["by"], shared["counted"]) == (16, "group", True)
    offset, turn = shared["deviations"]["offset_m"], np.radians(shared["deviations"]["turn_deg"])
    matrices = shared_matrices(again, problem.blocks.labels)
    V = shared["noise_px"] ** 2 * np.eye(len(again.J)) + offset**2 * matrices[0] + turn**2 * matrices[1]
    Q = np.linalg.inv(again.J.T @ again.J)
    expected = Q @ again.J.T @ V @ again.J @ Q
    np.testing.assert_allclose(np.sqrt(np.diag(again.covariance)), np.sqrt(np.diag(expected)), rtol=1e-4)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(again.covariance / scale, expected / scale, atol=1e-4)
    # Its degrees of freedom and intervals: Satterthwaite, from the likelihood's curvature in the three variances.
    parts, logs = [np.eye(len(V)), *matrices], np.log([shared["noise_px"] ** 2, offset**2, turn**2])

    def unlikely(x):
        return -restricted_likelihood(again, matrices, np.exp(logs + x))

    steps = 0.01 * np.eye(3)
    curvature = np.array(
        [
            [(unlikely(a + b) - unlikely(a - b) - unlikely(b - a) + unlikely(-a - b)) / 4e-4 for a in steps]
            for b in steps
        ]
    )
    growth = np.stack([np.diag(Q @ again.J.T @ part @ again.J @ Q) for part in parts], axis=1) * np.exp(logs)
    unsure = np.einsum("fi,ij,fj->f", growth, np.linalg.inv(curvature), growth)
    freedom = 2.0 * np.diag(expected) ** 2 / unsure
    np.testing.assert_allclose(list(document["degrees_of_freedom"].values()), freedom, rtol=1e-2)
    half = stats.t.ppf(0.975, freedom) * np.sqrt(np.diag(expected)) * again.unit
    np.testing.assert_allclose(list(document["interval95_half_width"].values()), half, rtol=1e-3)


def test_the_variances_are_at_the_restricted_maximum(of_poses):
    problem, document, again = of_poses
    shared = document["shared_errors"]
    matrices = shared_matrices(again, problem.blocks.labels)
    found = np.array(
        [shared["noise_px"], shared["deviations"]["offset_m"], np.radians(shared["deviations"]["turn_deg"])]
    )

    def unlikely(factors):
        return -restricted_likelihood(again, matrices, (found * factors) ** 2)

    best = optimize.minimize(unlikely, np.ones(3), method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-8})
    np.testing.assert_allclose(best.x, 1.0, atol=2e-3)
    alone = optimize.minimize_scalar(
        lambda s: -restricted_likelihood(again, [], [s**2]), bounds=(0.5, 10.0), method="bounded"
    )
    assert shared["evidence"] == pytest.approx(2.0 * (alone.fun - best.fun), rel=1e-3)
    assert shared["evidence"] > 20.0


def intervals_held(draws, made):
    held = []
    for seed in range(draws):
        problem, truth = made(seed)
        found = estimate(problem, truth)
        p = found.parameters
        turn = rotation_from_vector(p[:3]) @ rotation_from_vector(truth[:3]).T
        error = np.concatenate([np.degrees(vector_from_rotation(turn)), (p - truth)[3:]])
        held.append(np.abs(error) <= found.spread.half_width95)
    return float(np.mean(held))


@few_or_many(12, 30)
@pytest.mark.parametrize(
    ("poses", "repeats", "offset_m", "turn_deg"), [(20, 3, 0.01, 0.0), (12, 5, 0.01, 1.5), (30, 1, 0.0, 0.0)]
)
def test_intervals_hold_whether_poses_share_errors_or_not(poses, repeats, offset_m, turn_deg, draws):
    share = intervals_held(draws, lambda seed: posed(500 + seed, poses, repeats, offset_m, turn_deg))
    # Thirty rigs of ten correlated intervals: 0.95 within three deviations of a hundred independent ones.
    assert 0.885 <= share <= 0.995


def test_a_sound_walk_keeps_its_covariance():
    problem, truth = walked(5)
    bare = replace(problem, blocks=None)
    document, alone = finish(problem, truth), finish(bare, truth)
    assert document["shared_errors"]["by"] == "time"
    assert not document["shared_errors"]["counted"]
    for name in ("std", "interval95_half_width", "covariance", "polished"):
        assert document[name] == alone[name]
    assert (alone["shared_errors"], alone["halves"]) == (None, [])


def test_blocks_are_groups_or_stretches_of_time():
    groups = blocks_of({"x": [0.0] * 6, "group": ["b", "b", "a", "a", "b", 3]})
    assert (groups.kind, groups.labels.tolist()) == ("group", [0, 0, 1, 1, 0, 2])
    stamps = np.random.default_rng(0).permutation(np.repeat(np.arange(60), 2))
    walk = blocks_of({"x": [0.0] * 120, "stamp_ns": stamps.tolist(), "group": list(range(120))})
    assert walk.kind == "time" and walk.labels.max() == 7
    in_time = walk.labels[np.argsort(stamps, kind="stable")]
    assert np.all(np.diff(in_time) >= 0) and set(np.bincount(walk.labels)) <= {14, 16}
    assert all(len(set(walk.labels[stamps == stamp])) == 1 for stamp in range(60))
    assert blocks_of({"x": [0.0] * 39}) is None
    assert blocks_of({"x": [0.0] * 40}).kind == "order"


def test_stated_common_errors_enter_by_what_they_move():
    plain, truth = simulated("pinhole", 21)
    stated = {"elevation_deg": 0.04, "azimuth_deg": 0.02, "mark_v_px": 0.5, "tip_up_mm": 5.8, "range_mm": 17.3}
    problem = replace(plain, common_errors=stated)
    document, without = finish(problem, truth), finish(plain, truth)
    again, before = (Recomputed(one, plain.points, plain.pixels) for one in (document, without))
    x, y, z = plain.points.T
    flat, distance = np.hypot(x, y), np.linalg.norm(plain.points, axis=1)
    azimuth, elevation = np.arctan2(y, x), np.arcsin(z / distance)

    def turned(angles):
        if angles is None:
            return np.zeros(2)
        a, e = azimuth + np.radians(angles[0]), elevation + np.radians(angles[1])
        return distance[:, None] * np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)

    up = np.stack([-z * x / flat, -z * y / flat, flat], axis=1) / distance[:, None]

    def shifted(mm):
        if mm is None:
            return np.zeros(2)
        return plain.points + 1e-3 * (mm[0] * up + mm[1] * plain.points / distance[:, None])

    assert flat.min() > 0.1
    of_marks = np.tile([0.0, 1.0], len(x))[:, None]
    K = np.concatenate([again.by_pairs(turned), of_marks, again.by_pairs(shifted)], axis=1)
    S = np.diag(np.array([0.02, 0.04, 0.5, 5.8, 17.3]) ** 2)
    arm = np.linalg.solve(again.J.T @ again.J, again.J.T @ K)
    # The noise is what is left beside the common errors, as unknowns with their deviations for priors.
    beside = np.concatenate([again.J, K @ np.sqrt(S)], axis=1) / without["sigma_px"]
    left = np.concatenate([again.residuals / without["sigma_px"], np.zeros(5)])
    rows = np.concatenate([beside, np.eye(5, beside.shape[1], 10)])
    step = np.linalg.lstsq(rows, -left, rcond=None)[0]
    taken = np.trace(np.linalg.solve(rows.T @ rows, beside.T @ beside)) - 10
    squares = np.sum((left[:-5] + beside @ step) ** 2) / np.sum(left**2)
    share = squares / (1.0 - taken / (2 * len(x) - 10))
    assert 0.98 < share < 1.01 and abs(share - 1.0) > 1e-4
    grown = share * before.covariance + arm @ S @ arm.T
    scale = np.sqrt(np.outer(np.diag(grown), np.diag(grown)))
    np.testing.assert_allclose(again.covariance / scale, grown / scale, atol=1e-4)
    assert document["common_errors"] == stated


@pytest.mark.parametrize("stated", [{"height": 1.0}, {"mark_u_px": -1.0}])
def test_common_errors_that_are_none_are_refused(stated):
    with pytest.raises(DocumentError) as refused:
        simulated("pinhole", 3, common_errors=stated)
    assert refused.value.code == "bad_fit_request"


def test_the_clocks_deviation_needs_motion():
    problem, truth = simulated("pinhole", 3, common_errors={"clock_ms": 2.0})
    with pytest.raises(SolveError, match="how the corner moved"):
        estimate(problem, truth)
    velocities = np.tile([0.0, 1.2, 0.0], (len(problem.points), 1))
    moving = replace(problem, velocities=velocities)
    still = replace(problem, common_errors={})
    wider, narrow = estimate(moving, truth).spread, estimate(still, truth).spread
    # 2.4 mm to the side for all pairs: t, in the camera's frame, takes all of it.
    grown = np.sqrt(np.sum(wider.std[3:6] ** 2 - narrow.std[3:6] ** 2))
    assert grown == pytest.approx(2.4e-3, rel=1e-5)


def late(seed, late_ms, stated_ms=10.0):
    """(problem, truth): a walk to and fro whose marks show the apex `late_ms` before the pairs' points."""
    problem, truth = walked(seed)
    side = np.where(np.random.default_rng([seed, 6]).uniform(size=len(problem.points)) < 0.5, -1.2, 1.2)
    problem = replace(problem, velocities=side[:, None] * [0.0, 1.0, 0.0], common_errors={"clock_ms": stated_ms})
    return replace(problem, points=problem.moved_by(1e-3 * late_ms).points), truth


def test_the_clocks_offset_is_estimated_where_the_pairs_tell_it_better_than_it_is_stated():
    errors = []
    for seed in range(12):
        problem, truth = late(seed, 8.0)
        fitted, informed = estimate(problem, truth), estimate(late(seed, 0.0, 0.0)[0], truth)
        assert fitted.clock is not None and fitted.clock.std_ms < 5.0
        assert fitted.holding.common_errors["clock_ms"] == fitted.clock.std_ms
        errors.append((fitted.clock.offset_ms - 8.0) / fitted.clock.std_ms)
        # What the fit states is the deviation of a fit with one unknown more, no wider than with the offset stated.
        assert (fitted.spread.std[3:6] >= 0.97 * informed.spread.std[3:6]).all()
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.5


@pytest.mark.parametrize(("late_ms", "stated_ms"), [(60.0, 10.0), (1.0, 0.1), (8.0, 0.0)])
def test_an_offset_that_is_contradicted_or_known_better_is_left_as_stated(late_ms, stated_ms):
    problem, truth = late(3, late_ms, stated_ms)
    assert estimate(problem, truth).clock is None


def test_held_out_pairs_are_judged_at_the_clock_of_their_fit():
    problem, truth = late(5, 30.0, 15.0)
    fitted = estimate(problem, truth)
    apart = [distances(at_clock(problem, clock), fitted.parameters).mean() for clock in (None, fitted.clock)]
    assert apart[1] < 0.8 * apart[0]


@pytest.mark.parametrize("simulate", [posed, walked])
def test_pairs_without_noise_share_no_errors(simulate):
    """Computed pairs, as people bring them to try the service: what remains of them is rounding."""
    problem, truth = simulate(3)
    problem = replace(problem, pixels=predict(problem, truth)[0])
    document = finish(problem, truth)
    assert document["status"] == "ok" and document["polished"]["rms_px"] < 1e-6
    assert document["shared_errors"] is None and document["halves"] == []
