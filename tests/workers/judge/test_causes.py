"""Causes are rivals: one is named if the others explain less, and accuses by what it does to points of use."""

from dataclasses import replace

import numpy as np
import pytest

from tests.workers.judge.fits import checked, lens_of, rig
from tests.workers.solver.rigs import SIZE
from workers.judge.causes import image_velocities
from workers.judge.effects import PointsOfUse
from workers.solver.estimate import estimate


def walking(problem, seed=5, along=(0.0, 0.0, 0.0)):
    """The problem with velocities of the corner, m/s: all ways alike, or mostly one."""
    random = np.random.default_rng(seed)
    velocities = random.normal(0.0, 0.8, (len(problem.points), 3))
    if any(along):
        velocities = np.array(along) * random.uniform(0.2, 1.8, (len(problem.points), 1))
    return replace(problem, velocities=velocities)


def late(problem, start, seconds):
    """The marks as a camera whose clock is off by so much takes them."""
    return replace(problem, pixels=problem.pixels + seconds * image_velocities(estimate(problem, np.array(start))))


def test_two_milliseconds_are_told_of_good_marks_and_are_no_doubt():
    problem, start = rig("pinhole", noise_px=0.1)
    check = checked(late(walking(problem), start, 0.002), start)["clock"]
    assert check.verdict == "pass" and "The clocks differ by 2." in check.sentence
    assert check.figures["probability"] < 0.005 and check.figures["over_limit"] < 0.5


def test_a_focal_length_that_is_off_by_a_five_hundredth_is_no_other_camera():
    names = ("f_x", "f_y", "c_x", "c_y")
    values = dict(zip(names, lens_of("pinhole").tolist(), strict=True))
    values |= {name: 1.002 * values[name] for name in ("f_x", "f_y")}
    stated = {"model": "pinhole", **values, "image_size": list(SIZE)}
    checks = checked(*rig("pinhole", noise_px=0.2, locked=values, stated_lens=stated))
    assert checks["stated_lens"].verdict == "pass"
    assert checks["lens_model"].verdict != "stop"


def test_a_true_prior_is_not_accused_of_what_a_late_clock_does():
    problem, start = rig("pinhole", noise_px=0.3, priors={"f_x": {"mean": lens_of("pinhole")[0], "sigma": 1.0}})
    problem = late(walking(problem, along=(0.3, 1.0, 0.1)), start, 0.05)
    checks = checked(problem, start)
    assert checks["clock"].is_doubt and abs(abs(checks["clock"].figures["seconds"]) - 0.05) < 0.01
    assert checks["priors"].verdict == "pass"
    # Who does not know how the board moved has no other explanation.
    blind = checked(replace(problem, velocities=None), start)
    assert blind["clock"].verdict == "not_checked"


def test_a_board_that_goes_one_way_tells_no_clock():
    problem, start = rig("pinhole")
    still = replace(problem, velocities=np.tile([0.0, 0.8, 0.0], (len(problem.points), 1)))
    check = checked(still, start)["clock"]
    assert check.verdict == "not_checked" and check.remedy


@pytest.mark.parametrize("size", [0.0, 3.0])
def test_an_effect_is_what_points_move_by_and_sure_by_two_deviations(size):
    problem, start = rig("pinhole")
    found = estimate(problem, np.array(start))
    points = PointsOfUse(found)
    along = np.zeros((len(points.by_parameters), 2, 1))
    along[:, 0, 0] = 1.0
    effect = points.effect(along, np.array([size]), np.array([[0.25]]))
    limit_px = max(2.0, 1.5e-3 * found.parameters[6])
    assert effect.estimate <= size / limit_px + 1e-9 and (effect.estimate > 0.5 * size / limit_px or size == 0.0)
    assert effect.at_least == pytest.approx(effect.estimate * max(size - 1.0, 0.0) / max(size, 1.0))
    assert effect.per_deviation == pytest.approx(0.5 * points.effect(along, np.ones(1), np.zeros((1, 1))).estimate)
