"""Pairs that state covariances weigh by them, in search, polish, error bars and the naming of outliers."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.documents.errors import DocumentError
from apexcal.documents.fit_requests import fit_request
from tests.faults.jobs import SHORT
from tests.workers.solver.rigs import NOMINAL, PLAIN, SIZE, finish_plain, simulated
from workers.geometry.models import DEFAULT_MODELS
from workers.geometry.spherical import axes
from workers.solver.blocks import blocks_of
from workers.solver.covariances import SIGMAS, Covariances, covariances_of
from workers.solver.estimate import estimate
from workers.solver.narrowing import run_search
from workers.solver.outcomes import SolveError
from workers.solver.outliers import judge
from workers.solver.polish import polish, weighted_residuals
from workers.solver.problem import fit_problem
from workers.solver.residuals import predict
from workers.solver.uncertainty import uncertainty
from workers.solver.weighting import search_weights, whitened


def unequal(model, seed, pairs=222, best_deg=0.02, worst_deg=0.2, **request):
    """(problem with covariances, truth, exact points): vertices whose angles are known ten times better or worse."""
    exact, truth = simulated(model, seed, pairs=pairs, **request)
    rng = np.random.default_rng(seed)
    angle = np.radians(np.exp(rng.uniform(np.log(best_deg), np.log(worst_deg), pairs)))
    sigmas = np.column_stack([angle, angle * rng.uniform(0.7, 1.4, pairs), rng.uniform(0.005, 0.02, pairs)])
    columns = dict(zip(SIGMAS, sigmas.T.tolist(), strict=True))
    seen = exact.points + np.einsum("nij,nj->ni", axes(exact.points), sigmas * rng.normal(size=(pairs, 3)))
    return replace(exact, points=seen, covariances=covariances_of(columns, seen, 1.0)), truth, exact.points


def scores(model, seeds):
    """RMS error over Cramer-Rao sigma, and share inside the intervals: by covariances, and by equal weights."""
    squares, held = [], []
    for seed in seeds:
        problem, truth, exact = unequal(model, seed, **PLAIN)
        known = whitened(replace(problem, points=exact), truth)
        J = weighted_residuals(known, truth)[1] / known.mark_sigma_px
        sigma = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
        for one in (problem, replace(problem, covariances=None)):
            p = np.array(polish(one, truth).parameters)
            squares.append(np.mean(((p - truth) / sigma) ** 2))
            held.append(np.mean((np.abs(p - truth) <= uncertainty(one, p).half_width95)[3:]))
    return np.sqrt(np.mean(np.reshape(squares, (-1, 2)), axis=0)), np.mean(np.reshape(held, (-1, 2)), axis=0)


@pytest.mark.parametrize("model", DEFAULT_MODELS)
def test_weights_reach_the_information_bound_where_equal_ones_do_not(model):
    (weighted, equal), (held, _) = scores(model, range(24))
    assert weighted < 1.2
    assert equal > 1.12 * weighted
    assert 0.9 < held < 0.99


def test_the_covariance_in_the_image_is_what_noise_does_there():
    problem, truth, exact = unequal("kannala_brandt", 3, pairs=40)
    rng = np.random.default_rng(0)
    roots = np.linalg.cholesky(problem.covariances.points)
    drawn = [
        predict(replace(problem, points=exact + np.einsum("nij,nj->ni", roots, rng.normal(size=(40, 3)))), truth)[0]
        + rng.normal(size=(40, 2))
        for _ in range(3000)
    ]
    away = np.stack(drawn) - predict(replace(problem, points=exact), truth)[0]
    here = whitened(replace(problem, points=exact), truth)
    white = np.einsum("nij,knj->nki", here.whitening, away) / here.mark_sigma_px
    seen = np.einsum("nki,nkj->nij", white, white) / 3000
    np.testing.assert_allclose(seen, np.tile(np.eye(2), (40, 1, 1)), atol=0.12)


def test_one_size_for_all_is_the_same_as_no_covariances():
    problem, truth = simulated("brown_conrady", 5)
    n = len(problem.points)
    same = replace(problem, covariances=Covariances(np.zeros((n, 3, 3)), np.tile(4.0 * np.eye(2), (n, 1, 1))))
    with_them, without = (polish(one, truth).parameters for one in (same, problem))
    np.testing.assert_allclose(with_them, without, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(search_weights(same)[0], 1.0)
    plain, stated = (uncertainty(one, truth) for one in (problem, same))
    np.testing.assert_allclose(stated.std, plain.std, rtol=1e-9)
    assert stated.noise_scale == pytest.approx(0.5 * plain.sigma_px)
    assert plain.noise_scale is None


def test_the_search_counts_a_vertexs_error_as_the_angle_under_which_it_is_seen():
    """s / r across the ray, f s / r in the image; an error along the ray is not seen."""
    focal, sigma_m, mark_px = 800.0, 0.02, 0.7
    problem, _ = simulated("pinhole", 11, pairs=60, bounds={"f_x": (640.0, 1000.0), "f_y": (640.0, 1000.0)})
    ranges = np.linalg.norm(problem.points, axis=1)
    rays = problem.points / ranges[:, None]
    along = np.einsum("ni,nj->nij", rays, rays)
    marks = np.tile(mark_px**2 * np.eye(2), (60, 1, 1))
    for points in (np.tile(sigma_m**2 * np.eye(3), (60, 1, 1)), sigma_m**2 * np.eye(3) + 0.3**2 * along):
        weights, typical = search_weights(replace(problem, covariances=Covariances(points, marks)))
        expected = np.sqrt(mark_px**2 + (focal * sigma_m / ranges) ** 2)
        np.testing.assert_allclose(typical / weights, expected, rtol=1e-6)


def test_a_poor_vertex_is_no_outlier_and_a_good_one_is():
    problem, truth, _ = unequal("pinhole", 8)
    sigma = np.sqrt(problem.covariances.points.trace(axis1=1, axis2=2)) / np.linalg.norm(problem.points, axis=1)
    assert judge(problem, truth).outliers == []
    good = int(np.argmin(sigma))
    marks = problem.pixels.copy()
    marks[good, 0] += 7.0
    assert [one.index for one in judge(replace(problem, pixels=marks), truth).outliers] == [good]
    # Equal weights name a poor vertex, and overlook the mark that is far off for a good one.
    assert [one.index for one in judge(replace(problem, covariances=None), truth).outliers] == [146]
    assert sigma[146] > 2.5 * np.median(sigma)


def test_few_pairs_may_be_off_by_what_they_state_and_many_say_what_they_share():
    """What pairs share does not scatter. Of 39 nothing tells it; of 120 of a walk their likelihood does."""
    grown = []
    for pairs in (39, 120):
        problem, truth, _ = unequal("pinhole", 12, pairs=pairs)
        blocks = blocks_of({"x": problem.points[:, 0], "stamp_ns": np.arange(pairs) * 400_000_000})
        assert (blocks is None) == (pairs == 39)
        wide = Covariances(9.0 * problem.covariances.points, 9.0 * problem.covariances.marks)
        stated, larger = (
            estimate(replace(problem, covariances=each, blocks=blocks), truth) for each in (problem.covariances, wide)
        )
        assert larger.spread.noise_scale < 0.5
        grown.append(np.median(larger.spread.std / stated.spread.std))
    assert grown[0] > 2.0 and grown[1] < 1.5


@pytest.mark.parametrize("loss", ["mean", "saturating"])
def test_a_whole_run_by_covariances(loss):
    problem, truth, _ = unequal("pinhole", 9, loss=loss, schedule=SHORT)
    solution = finish_plain(problem, run_search(problem))
    assert (solution["status"], solution["weights"]) == ("ok", "covariances")
    assert solution["noise_scale"] == pytest.approx(1.0, abs=0.15)
    assert solution["interval95_half_width"]["f_x"] > abs(solution["intrinsics"]["f_x"] - truth[6]) * 0.5
    assert not any("ends lower" in one for one in solution["several_optima"])
    understated = replace(
        problem, covariances=Covariances(problem.covariances.points / 9, problem.covariances.marks / 9)
    )
    assert finish_plain(understated, run_search(understated))["noise_scale"] > 1.5


def test_columns_become_covariances():
    points = np.array([[10.0, 0.0, 0.0], [0.0, 5.0, 0.0]])
    sigmas = {"sigma_azimuth_rad": [1e-3, 2e-3], "sigma_elevation_rad": [3e-3, 4e-3], "sigma_range_m": [0.02, 0.03]}
    made = covariances_of(sigmas, points, 2.0)
    np.testing.assert_allclose(made.points[0], np.diag([0.02**2, 0.01**2, 0.03**2]), atol=1e-15)
    np.testing.assert_allclose(made.points[1], np.diag([0.01**2, 0.03**2, 0.02**2]), atol=1e-15)
    np.testing.assert_allclose(made.marks, [4 * np.eye(2)] * 2)
    np.testing.assert_allclose(covariances_of({"sigma_px": [0.5, 2]}, points, 1.0).marks[:, 0, 0], [0.25, 4.0])
    assert covariances_of({"sigma_px": [0.5, 2]}, points, 1.0).points.max() == 0.0
    some = covariances_of({"sigma_px": [0.5, None], "marks": [1, 4]}, points, 3.0)
    np.testing.assert_allclose(some.marks[:, 1, 1], [0.25, 9.0 / 4.0])


def test_the_spread_of_several_marks_tells_how_well_people_mark():
    rng, n = np.random.default_rng(0), 400
    marks = rng.integers(1, 5, n)
    spread = [
        float(np.sqrt(np.mean(np.sum((m - m.mean(axis=0)) ** 2, axis=1))))
        for m in (rng.normal(size=(count, 2)) * 1.7 for count in marks)
    ]
    spread[5] = 300.0  # somebody marked something else
    columns = {name: np.full(n, 1e-3).tolist() for name in SIGMAS}
    points = rng.uniform(3, 9, (n, 3))
    made = covariances_of(columns | {"marks": marks.tolist(), "spread_px": spread}, points, 1.0)
    np.testing.assert_allclose(made.marks[:, 0, 0] * marks, 1.7**2, rtol=0.15)
    few = covariances_of({name: values[:8] for name, values in columns.items()} | {"marks": [2] * 8}, points[:8], 1.0)
    np.testing.assert_allclose(few.marks[:, 1, 1], 0.5)


def test_covariances_that_are_none_are_refused():
    problem, _ = simulated("pinhole", 1, pairs=20)
    good = np.tile(np.eye(3), (20, 1, 1)), np.tile(np.eye(2), (20, 1, 1))
    for place, value in (((4, 0, 0), np.nan), ((4, 0, 1), 0.5), ((4, 1, 1), -1.0)):
        for which in (0, 1):
            bad = [one.copy() for one in good]
            bad[which][place] = value
            with pytest.raises(SolveError, match="pair 4") as caught:
                Covariances(*bad)
            assert caught.value.code == "bad_covariances"
    stated = Covariances(*good)

    def made(covariances=None, **asked):
        request = fit_request(model="pinhole", image_size=SIZE, nominal=NOMINAL, **asked)
        return fit_problem(request, problem.points, problem.pixels, covariances=covariances)

    for make, code in (
        (lambda: replace(problem, covariances=Covariances(good[0][:9], good[1][:9])), "bad_covariances"),
        (lambda: covariances_of({"sigma_azimuth_rad": [1e-3]}, [[1, 2, 3]], 1.0), "no_covariances"),
        (lambda: made(weights="covariances"), "no_covariances"),
        (lambda: made(weights="vertices"), "bad_fit_request"),
    ):
        with pytest.raises(DocumentError) as caught:
            make()
        assert caught.value.code == code
    for asked, used in (({}, None), ({"weights": "equal"}, None), ({"weights": "covariances"}, stated)):
        assert made(stated, **asked).covariances is used
