"""Weak priors on distortion apply only if the pairs hardly determine it and the request leaves it free."""

from dataclasses import replace

import numpy as np
import pytest

from apexcal.geometry.rotations import vector_from_rotation
from tests.workers.solver.rigs import decentred, simulated
from tests.workers.solver.walks import finish
from workers.solver.estimate import estimate
from workers.solver.residuals import predict, transform_of

LENSES = {"kannala_brandt": ("k1", "k2", "k3", "k4"), "brown_conrady": ("k1", "k2", "k5", "k3", "k4")}


def narrow(model, seed, **request):
    """(problem, truth, whole problem): the pairs in the middle quarter of the image alone."""
    problem, truth = simulated(model, seed, pairs=400, **request)
    off = np.abs(problem.pixels / (0.5 * np.array(problem.image_size)) - 1.0).max(axis=1)
    kept = np.flatnonzero(off < 0.4)
    given = {name: getattr(problem, name)[kept] for name in ("points", "pixels", "weights")}
    return replace(problem, **given), truth, problem


@pytest.mark.parametrize("model", LENSES)
def test_no_coefficient_of_a_narrow_walk_runs_to_its_bound(model):
    worse = []
    for seed in range(4):
        problem, truth, whole = narrow(model, 60 + seed)
        document = finish(problem, truth)
        assert not [name for name in document["at_bounds"] if name.startswith("k")]
        lens = document["intrinsics"]
        corner = 0.5 * problem.diagonal_px / np.sqrt(lens["f_x"] * lens["f_y"])
        priors = document["weak_priors"]
        # Of the fit before the priors, whose focal length may be some per cent off.
        for name, order in zip(LENSES[model][: 3 if model == "brown_conrady" else 4], (1, 2, 3, 4), strict=False):
            assert priors[name] == pytest.approx(min(0.2, 0.3 / corner ** (2 * order)), rel=0.4)
        # A lens off its axis by a tenth of the corner's radius.
        for name in LENSES[model][3:] if model == "brown_conrady" else ():
            assert priors[name] == pytest.approx(0.1 * corner * min(0.2, 0.3 / corner**2), rel=0.4)
        without = finish(replace(problem, unstated=frozenset()), truth)
        assert without["weak_priors"] == {}
        exact = predict(whole, truth)[0]
        for one in (document, without):
            p = np.array([one["polished"]["parameters"][name] for name in problem.names])
            worse.append(
                float(np.sqrt(np.mean(np.minimum(np.sum((predict(whole, p)[0] - exact) ** 2, axis=1), 1e4))))
            )
    assert np.median(worse[::2]) < 0.7 * np.median(worse[1::2]), "outside of what was marked"


@pytest.mark.parametrize(
    "said",
    [{"bounds": {"k1": [-0.5, 0.5]}}, {"priors": {"k1": {"mean": 0.0, "sigma": 0.1}}}, {"locked": {"k1": 0.0}}],
)
def test_what_the_request_says_of_a_coefficient_stands(said):
    problem, truth, _ = narrow("kannala_brandt", 61, **said)
    assert "k1" not in problem.unstated and "k2" in problem.unstated
    assert "k1" not in finish(problem, truth)["weak_priors"]


def test_the_papers_preset_and_a_wide_pinhole_have_none():
    problem, _, _ = narrow("brown_conrady", 61, preset="paper")
    assert problem.unstated == frozenset()
    assert finish(*simulated("pinhole", 3))["weak_priors"] == {}


@pytest.mark.parametrize("term", [0.0, 0.0015])
def test_a_fisheye_off_its_axis_turns_the_mount_by_no_more_than_is_stated(term):
    """Marks of 1 px noise, of lenses with tangential terms in the plane of theta; 0 is a lens on its axis."""
    scores, turns, stated = [], [], []
    for seed in range(6):
        problem, truth = simulated("kannala_brandt", 80 + seed)
        problem = decentred(problem, truth, term * np.array([np.cos(seed), np.sin(seed)]))
        fit = estimate(problem, truth)
        turn = np.degrees(
            vector_from_rotation(transform_of(problem, fit.parameters).R @ transform_of(problem, truth).R.T)
        )
        scores += (turn / fit.spread.std[:3]).tolist()
        turns.append(np.linalg.norm(turn))
        stated.append(np.linalg.norm(fit.spread.std[:3]))
        alone = estimate(replace(problem, locked={"c_x": truth[8], "c_y": truth[9]}), truth)
        assert np.linalg.norm(alone.spread.std[:3]) < stated[-1], "with a locked centre nothing is added"
    assert np.abs(scores).max() < 3.0
    assert np.sqrt(np.mean(np.square(scores))) > 0.4
    if term:
        assert np.median(turns) > 0.8
    else:
        assert np.median(stated) < 0.8


@pytest.mark.parametrize("wrong", [0, 40])
def test_a_quotient_s_terms_which_pairs_hardly_tell_apart_are_held(wrong):
    """Two polynomials that share a factor are one lens; only the priors tell which."""
    problem, truth = simulated("rational_polynomial", 7, pairs=400)
    exact = problem.pixels.copy()
    exact[:wrong] += np.random.default_rng(7).uniform(30, 80, (wrong, 2))
    document = finish(replace(problem, pixels=exact), truth)
    assert document["status"] == "ok" and document["at_bounds"] == []
    assert set(document["weak_priors"]) == {"k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"}
    named = {one["index"] for one in document["outliers"]}
    assert set(range(wrong)) <= named and len(named) <= wrong + 4
    p = np.array([document["polished"]["parameters"][name] for name in problem.names])
    off = predict(problem, p)[0] - predict(problem, truth)[0]
    # Of 18 parameters from 400 marks with 1 px of noise: 0.15 px in each direction.
    assert np.sqrt(np.mean(off**2)) < 0.25


def test_marks_at_one_height_leave_the_pixels_square_unless_they_say_otherwise():
    """Heights tell f_y; without them only that pixels are square does. Where they show not to be, they stay so."""
    problem, truth = simulated("pinhole", 5, pairs=1500)
    assert "aspect" not in estimate(problem, truth).weak
    level = np.argsort(np.abs(problem.points[:, 2] - np.median(problem.points[:, 2])))[:40]
    flat = replace(problem, **{name: getattr(problem, name)[level] for name in ("points", "pixels", "weights")})
    square = estimate(flat, truth)
    assert square.weak == {"aspect": 0.005}
    free = estimate(replace(flat, unstated=frozenset()), truth)
    off = [abs(fit.parameters[7] / fit.parameters[6] - truth[7] / truth[6]) for fit in (square, free)]
    assert off[0] < 0.015 < off[1] and square.spread.std[7] < 0.7 * free.spread.std[7]
    squeezed = replace(problem, pixels=problem.pixels * [1.0, 0.8], image_size=(1280, 768))
    wide = estimate(squeezed, truth * np.where(np.isin(problem.names, ("f_y", "c_y")), 0.8, 1.0))
    assert "aspect" not in wide.weak and wide.parameters[7] / wide.parameters[6] == pytest.approx(0.8, abs=0.02)
