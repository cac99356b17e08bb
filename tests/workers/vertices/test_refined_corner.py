"""The posterior in a plane, against boards whose rays are made by hand and against plain summation."""

import math

import numpy as np
import pytest

from workers.vertices.refined.corner import integrate

EDGES = (0.6, 0.9)


def rays(apex, roll, step=0.05, reach=1.6):
    """A grid of rays at even steps and what each meets: hits and misses of a board with that apex and roll."""
    left, up = (part.ravel() for part in np.meshgrid(np.arange(-reach, reach, step), np.arange(-reach, 0.3, 0.3)))
    dl, du = left - apex[0], up - apex[1]
    p, q = dl * math.cos(roll) - du * math.sin(roll), -dl * math.sin(roll) - du * math.cos(roll)
    hit = (p >= 0) & (p <= EDGES[0]) & (q >= 0) & (q <= EDGES[1])
    return left, up, np.where(hit, 50.0, 0.002)


def posterior(
    left, up, ratio, *, growth=0.0, edges=EDGES, roll=(math.radians(45), math.radians(3)), cells=36, half=0.15
):
    count = left.size
    rolls = roll[0] + roll[1] * np.linspace(-3, 3, 31)
    prior = -0.5 * ((rolls - roll[0]) / roll[1]) ** 2
    return integrate(
        left, up, np.full(count, growth), np.full(count, 0.004), ratio, *edges, 0.0,
        rolls, prior, np.zeros((31, 2)), np.full((31, 2), half), cells,
    )[0]  # fmt: skip


def test_the_apex_of_many_boards_is_found_within_what_the_rays_leave_open():
    random = np.random.default_rng(1)
    scaled = []
    for _ in range(60):
        apex = random.uniform(-0.03, 0.03, 2)
        roll = math.radians(random.normal(45, 3))
        out = posterior(*rays(apex, roll))
        scaled.append(np.array([out[1] - apex[0], out[2] - apex[1], out[3] - roll]) / np.sqrt(out[4:7]))
        assert out[10] > -2.0  # no ray contradicts the board
    rms = np.sqrt(np.mean(np.square(scaled), axis=0))
    assert (rms > 0.6).all()
    assert (rms < 1.3).all()


def test_a_finer_grid_gives_the_same_moments():
    left, up, ratio = rays((0.01, -0.02), math.radians(46))
    coarse, fine = posterior(left, up, ratio, cells=36), posterior(left, up, ratio, cells=120)
    assert coarse[0] == pytest.approx(fine[0], abs=0.2)
    np.testing.assert_allclose(coarse[1:4], fine[1:4], atol=0.002)
    np.testing.assert_allclose(np.sqrt(coarse[4:7]), np.sqrt(fine[4:7]), rtol=0.12)


def test_edges_that_seem_to_lie_farther_out_lift_the_apex_by_the_square_root_of_two():
    left, up, ratio = rays((0.0, 0.0), math.radians(45), step=0.01)
    only_top = up > -0.35  # so that the lower edges do not hold against it
    left, up, ratio = left[only_top], up[only_top], ratio[only_top]
    without = posterior(left, up, ratio, edges=(2.0, 2.0))
    grown = posterior(left, up, ratio, growth=0.02, edges=(2.0, 2.0))
    assert without[2] - grown[2] == pytest.approx(0.02 * math.sqrt(2), abs=0.004)


def test_rays_that_contradict_any_board_show():
    left, up, ratio = rays((0.0, 0.0), math.radians(45))
    middle = np.argmin(np.hypot(left, up + 0.45))
    ratio[middle] = 0.002
    assert posterior(left, up, ratio)[10] < -4.0


def test_rays_that_tell_nothing_leave_the_prior():
    left, up, _ = rays((0.0, 0.0), math.radians(45))
    out = posterior(left, up, np.ones(left.size))
    assert math.degrees(out[3]) == pytest.approx(45.0)
    assert math.degrees(math.sqrt(out[6])) == pytest.approx(3.0, rel=0.1)
    assert out[0] == pytest.approx(math.log(0.09 * np.exp(-0.5 * np.linspace(-3, 3, 31) ** 2).sum()), abs=1e-6)
