"""The experiment's own plumbing: with a perfect detector nothing is left but the errors that are switched on."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.paper.budget import score
from benchmarks.paper.fits import errors_of_truth, errors_on, fit
from benchmarks.paper.pairs import OFFSET_NS, Switches, Way, make_pairs, weights_of, without
from benchmarks.paper.recordings import Walked, Wanted, camera_of, field_points
from workers.simulation.rig import START_NS
from workers.simulation.truth import scan_times_s
from workers.vertices.vertex import Vertex

NONE = Switches(vertices=False, clocks=False, clicks=False)


def perfect(name, seed, sweeps=2400):
    """A walk whose vertices are the true apex, at the moment at which the sensor looked there."""
    walked = Walked(Wanted(name, seed, 222, sweeps, sweeps), {"refined": []})
    when_s = scan_times_s(walked.rig, np.arange(1, sweeps - 30) * 0.1)
    apex = walked.rig.walk.poses(when_s).apex
    sure = ((1e-9, 0.0, 0.0), (0.0, 1e-9, 0.0), (0.0, 0.0, 1e-6))
    walked.vertices["refined"] = [
        Vertex(tuple(xyz), START_NS + round(at * 1e9), 0, number, 1, "refined", sure)
        for number, (at, xyz) in enumerate(zip(when_s.tolist(), apex.tolist(), strict=True))
    ]
    return walked


@pytest.fixture(scope="module")
def train():
    return perfect("train", 31)


@pytest.fixture(scope="module")
def test():
    return perfect("test", 32)


def test_without_any_error_the_fit_is_the_truth(train, test):
    camera = camera_of("brown_conrady", 31)
    pairs, heldout = (make_pairs(walked, camera, Way("refined"), NONE, 0) for walked in (train, test))
    assert len(pairs.points) == 222
    fitted = fit(pairs, "brown_conrady", 0)
    truth = errors_of_truth(fitted, camera, field_points(train.rig.scene.ground_z))
    assert len(truth) > 1000
    assert truth.mean() < 1e-3
    assert errors_on(fitted, heldout).max() < 0.01


def test_clocks_that_differ_move_the_board_and_a_known_offset_brings_it_back(train):
    camera = camera_of("brown_conrady", 31)
    clocks = replace(NONE, clocks=True)
    off = {}
    for name, way in {
        "nearest": Way("refined"),
        "known": Way("refined", "nearest", OFFSET_NS),
        "moved": Way("refined", "interpolate", OFFSET_NS),
    }.items():
        pairs = make_pairs(train, camera, way, replace(clocks, vertices=True), 0)
        off[name] = np.linalg.norm(camera.project(pairs.points) - pairs.marks, axis=1).mean()
        assert len(set(pairs.stamps_ns.tolist())) == len(pairs.stamps_ns)
    assert off["nearest"] > 1.3 * off["known"] > 10.0 * off["moved"]
    assert off["moved"] < 0.05


def test_clicks_alone_leave_their_floor(train, test):
    camera = camera_of("brown_conrady", 31)
    clicks = replace(NONE, clicks=True)
    pairs, heldout = (make_pairs(walked, camera, Way("refined"), clicks, 0) for walked in (train, test))
    fitted = fit(pairs, "brown_conrady", 0)
    assert errors_on(fitted, heldout).mean() == pytest.approx(np.sqrt(np.pi / 2.0), rel=0.2)
    assert 0.02 < errors_of_truth(fitted, camera, field_points(train.rig.scene.ground_z)).mean() < 1.0


def test_sources_are_switched_off_in_turn_and_the_offset_is_found(train, test):
    found = score(train, test, "refined+clock", "pinhole", 0, ("clicks", "model"))
    assert set(found.figures) == {"all", "clicks", "model"}
    assert found.pairs == (222, 222)
    assert found.offset_ms == pytest.approx(30.0, abs=15.0)  # its standard deviation is 4 ms
    whole = found.figures["all"]
    assert found.figures["clicks"]["heldout_px"] < whole["heldout_px"]
    assert found.figures["model"]["truth_px"] < whole["truth_px"]


def test_uncertain_vertices_count_less(train):
    pairs = make_pairs(train, camera_of("pinhole", 31), Way("refined"), replace(NONE, vertices=True), 0)
    sure = weights_of(pairs, 430.0)
    doubtful = weights_of(replace(pairs, covariance=1e4 * pairs.covariance), 430.0)
    assert (sure > 0.99).all()
    assert (doubtful < 0.6).all()
    unknown = weights_of(replace(pairs, covariance=np.full_like(pairs.covariance, np.nan)), 430.0)
    assert (unknown == 1.0).all()


def test_only_what_is_named_is_switched_off():
    assert without(Switches(), "clocks") == Switches(clocks=False)
    assert without(Switches(), "model") == Switches()
