"""What a result states of its noise and deviations, on marks that are wrong and beside priors.

The covariances are computed again here, from the problem's own numbers with plain NumPy.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from apexcal.geometry.rotations import vector_from_rotation
from tests.workers.solver.draws import few_or_many
from tests.workers.solver.rigs import PLAIN, decentred, residual_pairs, simulated
from tests.workers.solver.walks import finish
from workers.solver.estimate import estimate
from workers.solver.residuals import predict
from workers.solver.uncertainty import Uncertainty


def spoiled(problem, share, seed=0):
    """The problem with this share of its marks anywhere in the image, and which they are."""
    rng = np.random.default_rng(seed)
    wrong = rng.choice(len(problem.points), max(1, round(share * len(problem.points))), replace=False)
    marks = problem.pixels.copy()
    marks[wrong] = rng.uniform(0, problem.image_size, (len(wrong), 2))
    return replace(problem, pixels=marks), set(wrong.tolist())


@pytest.mark.parametrize("share", [0.004, 0.1, 0.3])
def test_wrong_marks_that_a_robust_loss_ignores_do_not_widen_what_it_states(share):
    clean, truth = simulated("pinhole", 47, loss="saturating", outliers="keep")
    problem, wrong = spoiled(clean, share)
    solution = finish(problem, truth)
    assert solution["status"] == "ok"
    assert 0.8 < solution["sigma_px"] < 1.25, "the marks that belong have 1 px of noise"
    alone = finish(clean, truth)
    for name, std in solution["std"].items():
        assert std == pytest.approx(alone["std"][name], rel=0.5), name
    assert {one["index"] for one in solution["outliers"]} <= wrong


def test_wrong_marks_that_are_kept_count_as_what_they_moved_the_result_by():
    clean, truth = simulated("pinhole", 47, **PLAIN)
    problem, _ = spoiled(clean, 0.1)
    kept, without = finish(problem, truth), finish(replace(problem, outliers="exclude"), truth)
    turns = [np.array(one["transform"]["rotation"]["matrix"]) for one in (kept, without)]
    turn = turns[0] @ turns[1].T
    moved = [np.degrees(vector_from_rotation(turn)).tolist()]
    moved += [[kept["parameters"][name] - without["parameters"][name] for name in list(kept["parameters"])[6:]]]
    moved = np.concatenate(moved)
    expected = np.array(without["covariance"]["matrix"]) + np.outer(moved, moved)
    np.testing.assert_allclose(kept["covariance"]["matrix"], expected, rtol=1e-4, atol=1e-9 * expected.max())
    assert kept["sigma_px"] == pytest.approx(without["sigma_px"], rel=1e-6) and kept["sigma_px"] < 1.25
    for name, shift in zip(kept["covariance"]["names"], moved.tolist(), strict=True):
        # A shift that is known and an error by Student's t: 95 % of their sums lie within the half width.
        half, own = kept["interval95_half_width"][name], without["std"][name]
        freedom = kept["degrees_of_freedom"][name] * (own / kept["std"][name]) ** 4
        inside = [stats.t.cdf((end - shift) / own, freedom) for end in (-half, half)]
        assert inside[1] - inside[0] == pytest.approx(0.95, abs=2e-3)
        assert half < 1.97 * kept["std"][name]


@few_or_many(20, 80)
@pytest.mark.parametrize("model", ["pinhole", "kannala_brandt"])
def test_intervals_beside_wrong_marks_that_are_kept_hold_their_share(model, draws):
    """Marks on one side of the apex, as those of another corner are, move the result."""
    held, before = [], []
    for seed in range(draws):
        clean, truth = simulated(model, 900 + seed, **PLAIN)
        wrong = np.random.default_rng(seed).choice(len(clean.points), 22, replace=False)
        marks = clean.pixels.copy()
        marks[wrong] += (5.0, 60.0)
        found = estimate(replace(clean, pixels=marks), truth)
        error = np.abs(found.parameters - truth)[3:]
        held += (error <= found.spread.half_width95[3:]).tolist()
        assert found.errors is not None and found.kept is not None
        before += (
            error <= 2.0 * np.sqrt(np.diag(replace(found.errors, moved=np.zeros(0)).covariance()))[3:]
        ).tolist()
    assert np.mean(held) >= 0.9 > 0.6 > np.mean(before)


@few_or_many(20, 80)
@pytest.mark.parametrize("model", ["pinhole", "kannala_brandt"])
def test_intervals_beside_wrong_marks_hold_their_share(model, draws):
    held = []
    for seed in range(draws):
        clean, truth = simulated(model, 900 + seed, loss="saturating", outliers="keep")
        if model == "kannala_brandt":
            clean = decentred(clean, truth, np.random.default_rng([seed, 2]).normal(0.0, 0.002, 2))
        found = estimate(spoiled(clean, 0.1, seed)[0], truth)
        held += (np.abs(found.parameters - truth) <= found.spread.half_width95)[3:].tolist()
    assert 0.88 <= np.mean(held) <= 0.99


def test_a_few_wrong_marks_are_named_also_where_the_pairs_hold_too_little():
    problem, truth = simulated("brown_conrady", 48, **PLAIN)
    # A narrow rig: nothing but a small patch far ahead.
    ahead = np.argsort(np.hypot(*(problem.pixels - np.array(problem.image_size) / 2).T))[:40]
    narrow = replace(
        problem, points=problem.points[ahead], pixels=problem.pixels[ahead].copy(), weights=problem.weights[ahead]
    )
    narrow.pixels[:3] += (60.0, -45.0)
    solution = finish(narrow, truth)
    assert solution["status"] == "not_determined"
    assert {one["index"] for one in solution["outliers"]} == {0, 1, 2}


def test_the_covariance_is_that_of_marks_and_priors_each_with_its_own_sigma():
    clean, truth = simulated("pinhole", 49, noise_px=0.3)
    sigmas = {"t_x": 0.05, "t_y": 0.02, "f_x": 2.0}
    names = clean.names
    priors = {name: (truth[names.index(name)], sigma) for name, sigma in sigmas.items()}
    found = estimate(replace(clean, priors=priors), truth)
    p, problem = found.parameters, found.fitted

    def moved(index, by):
        q = p.copy()
        q[index] += by
        return predict(problem, q)[0].ravel()

    steps = [1e-6] * 6 + [1e-3] * 4
    J = np.stack([(moved(i, h) - moved(i, -h)) / (2 * h) for i, h in enumerate(steps)], axis=1)
    P = np.diag([1.0 / sigmas[name] ** 2 if name in sigmas else 0.0 for name in names])
    residuals = residual_pairs(problem, p).ravel()
    sigma = 0.3
    for _ in range(20):
        A = J.T @ J / sigma**2 + P
        taken = np.trace(np.linalg.solve(A, J.T @ J / sigma**2))
        sigma = np.sqrt(residuals @ residuals / (len(residuals) - taken))
    assert found.spread.sigma_px == pytest.approx(sigma, rel=2e-3)
    expected = np.sqrt(np.diag(np.linalg.inv(A)))[3:]
    np.testing.assert_allclose(found.spread.std[3:], expected, rtol=5e-3)
    # And it is the optimum under that noise.
    gradient = J.T @ residuals / sigma**2 + P @ (p - truth)
    np.testing.assert_allclose(gradient * found.spread.std.clip(max=1.0), 0.0, atol=0.05)


@pytest.mark.parametrize(("shift", "own"), [(0.5, 5.0), (1.0, 12.0), (3.0, 40.0)])
def test_a_shift_and_a_deviation_known_from_few_pairs_make_one_interval(shift, own):
    """|shift + s T| with T of `own` freedoms. What is stated is std^2 = s^2 + shift^2, whose freedom is
    own (std / s)^4, as the shift's part is exact (Satterthwaite 1946).
    """
    spread = 0.8
    std = np.hypot(spread, shift)
    stated = Uncertainty(
        names=("t_x",), units=("m",), std=np.array([std]), covariance=np.array([[std**2]]), rank=1, sigma_px=1.0,
        freedoms=np.array([own * (std / spread) ** 4]), shift=np.array([shift]),
    )  # fmt: skip
    (half,) = stated.half_width95
    inside = stats.t.cdf((half - shift) / spread, own) - stats.t.cdf(-(half + shift) / spread, own)
    assert inside == pytest.approx(0.95, abs=1e-6)
