"""The estimate of the board's size: the joint climb, what a covariance allows, and drawn poses end to end."""

import numpy as np
import pytest

from benchmarks.detection.sizes import run
from workers.vertices.refined.size import SizeEstimate, climb


def test_the_climb_goes_along_a_ridge_that_single_coordinates_do_not_follow():
    curvature = np.array([[1.0, 0.99], [0.99, 1.0]]) * 4e4
    top = np.array([0.8, 0.6])

    def value(x):
        return -0.5 * (x - top) @ curvature @ (x - top)

    at, inverse, highest = climb(value, np.array([0.7, 0.7]), [0, 1], np.array([0.02, 0.02]))
    assert at == pytest.approx(top, abs=1e-6)
    assert highest == pytest.approx(0.0, abs=1e-6)
    assert inverse == pytest.approx(np.linalg.inv(curvature), rel=1e-6)


def test_a_coordinate_that_is_not_open_stays():
    at, inverse, _ = climb(lambda x: -1e3 * np.sum(x**2), np.array([0.5, 0.2]), [1], np.array([0.02, 0.02]))
    assert at == pytest.approx([0.5, 0.0], abs=1e-6)
    assert not inverse[0].any() and not inverse[:, 0].any()


def estimate(growth_sigma, soft=0.3e-3, growth=0.3e-3):
    """Boards at 5 m: a radian of growth makes an edge 10 m shorter."""
    towards = np.array([-10.0, -10.0, 1.0])
    spread = np.diag([0.004**2, 0.004**2, 0.0]) + growth_sigma**2 * np.outer(towards, towards)
    return SizeEstimate.over_growth((0.62, 0.84), growth, spread, soft)


def test_a_growth_that_boards_do_not_tell_stays_in_the_covariance():
    told, untold = estimate(0.05e-3), estimate(5e-3)
    assert np.sqrt(np.diag(told.covariance)) == pytest.approx([0.004, 0.004], rel=0.05)
    # The prior of the growth leaves 0.5 mrad at both edges, both ways: 5 mm, and its tail more.
    assert np.sqrt(np.diag(untold.covariance)).min() > 0.0064
    assert untold.covariance[0, 1] > 0.5 * untold.covariance[0, 0]
    assert untold.slack == pytest.approx(0.008, rel=0.05)


@pytest.mark.parametrize(
    ("stated", "contradicts"),
    [
        ((0.62, 0.84), False),
        ((0.84, 0.62), False),
        ((0.625, 0.845), False),
        ((0.65, 0.88), True),
        ((0.58, 0.8), True),
    ],
)
def test_a_stated_size_is_a_measurement(stated, contradicts):
    facts = estimate(0.05e-3).facts(stated)
    assert facts.contradicts is contradicts
    assert facts.seen_m == pytest.approx((0.62, 0.84), abs=0.001)


def test_blooming_edges_explain_a_size_that_looks_larger_but_none_that_looks_smaller():
    untold = estimate(5e-3)
    assert not untold.facts((0.59, 0.81)).contradicts
    assert untold.facts((0.66, 0.88)).contradicts
    assert not untold.facts((0.0, 0.0)).contradicts


@pytest.mark.parametrize(("seed", "poses"), [(520003, 8), pytest.param(520000, 16, marks=pytest.mark.slow)])
def test_drawn_poses_tell_the_size(seed, poses):
    """Poses of a drawn sensor, board and person, with the size open, right and wrong."""
    for case, _, count, enough, _, vertices, gross, _, deviations, contradicts in run(seed, (poses,)):
        assert enough and vertices >= 0.8 * count and gross == 0
        assert deviations < 4.0
        assert contradicts == ("10 %" in case) or case == "5 % wrong"
