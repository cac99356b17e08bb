"""The estimate of the board's size: the joint climb, what a covariance allows, and drawn poses end to end."""

import numpy as np
import pytest

from benchmarks.detection.sizes import run
from workers.vertices.board.size import BEAM_SIGMA_RAD, SizeEstimate, climb


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


def estimate(blooming_sigma):
    """Boards at 5 m: a radian of growth makes an edge 10 m shorter. The growth is measured as half of a beam."""
    towards = np.array([-10.0, -10.0, 1.0])
    spread = np.diag([0.004**2, 0.004**2, 1e-12]) + blooming_sigma**2 * np.outer(towards, towards)
    return SizeEstimate(np.array([0.62, 0.84, BEAM_SIGMA_RAD]), spread)


def test_a_growth_that_boards_do_not_tell_stays_in_the_covariance():
    _, told = estimate(0.05e-3).usual()
    _, untold = estimate(20e-3).usual()
    assert np.sqrt(np.diag(told)[:2]) == pytest.approx([0.004, 0.004], rel=0.05)
    assert np.sqrt(untold[2, 2]) == pytest.approx(BEAM_SIGMA_RAD, rel=0.05)
    assert np.sqrt(np.diag(untold)[:2]) == pytest.approx(np.hypot(0.004, 10.0 * BEAM_SIGMA_RAD), rel=0.05)
    assert untold[0, 1] > 0.9 * untold[0, 0]


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


def test_blooming_edges_may_explain_a_size_and_then_it_is_used_though_it_is_contradicted():
    untold = estimate(5e-3)
    unusual, never = untold.facts((0.55, 0.77)), untold.facts((0.72, 0.94))
    assert unusual.contradicts and not unusual.replaces
    assert never.contradicts and never.replaces
    assert not untold.facts((0.60, 0.82)).contradicts
    assert not untold.facts((0.0, 0.0)).contradicts


ALL = ("open", "right", "5 % wrong", "10 % wrong")


@pytest.mark.parametrize(
    ("seed", "poses", "cases"), [(520003, 8, ALL[3:]), pytest.param(520000, 16, ALL, marks=pytest.mark.slow)]
)
def test_drawn_poses_tell_the_size(seed, poses, cases):
    """Poses of a drawn sensor, board and person, with the size open, right and wrong."""
    for row in run(seed, (poses,), cases):
        assert row.enough and len(row.off_m) >= 0.8 * row.poses and row.gross == 0
        assert row.z < 4.0
        assert row.contradicted == ("10 %" in row.case) or row.case == "5 % wrong"
