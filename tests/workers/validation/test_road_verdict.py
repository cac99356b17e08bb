"""The peak of a score over turns, and the verdict on it: how clear, how sure and how far it must be."""

import numpy as np
import pytest

from workers.validation.offsets import Peak, find_peak, find_roll, turn_grid
from workers.validation.road_verdict import ScoredDrive, judge, judge_axes


def verdict(parts=40, **changed):
    peak = {
        "pitch_deg": 0.0,
        "yaw_deg": 0.4,
        "sigma_pitch_deg": 0.03,
        "sigma_yaw_deg": 0.03,
        "score": 1.0,
        "lead": 5.0,
    }
    return judge(ScoredDrive("edges", 30, parts, 900, 0.5, 0.3, Peak(**(peak | changed))))["verdict"]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, "disagrees"),
        # Images turned around lead by 0.6 of their deviation, so a lead of less than two is none.
        ({"lead": 1.9}, "unknown"),
        ({"lead": 2.1}, "disagrees"),
        # A knock of a quarter of a degree must show: 0.18 to both sides is 0.255 together, 0.17 is 0.24.
        ({"sigma_pitch_deg": 0.18, "sigma_yaw_deg": 0.18}, "unknown"),
        ({"sigma_pitch_deg": 0.17, "sigma_yaw_deg": 0.17, "yaw_deg": 0.7}, "disagrees"),
        # Chi-square of two freedoms exceeds 13.82 once in a thousand times: 3.72 deviations.
        ({"sigma_yaw_deg": 0.4 / 3.65}, "agrees"),
        ({"sigma_yaw_deg": 0.4 / 3.78}, "disagrees"),
        # Columns of a sensor are wider apart.
        ({"yaw_deg": 0.14}, "agrees"),
        ({"yaw_deg": 0.16}, "disagrees"),
        ({"parts": 7}, "unknown"),
        ({"parts": 8}, "disagrees"),
    ],
)
def test_each_limit_from_both_sides(changed, said):
    assert verdict(**changed) == said


@pytest.mark.parametrize("count", [4, 60])
def test_the_deviation_of_a_peak_is_that_of_a_mean(count):
    """Each group's peak lies elsewhere; that of all is their mean, so its deviation is s / sqrt(G) (Student 1908)."""
    offsets = turn_grid()
    turns = np.degrees(offsets[:, :2])
    peaks = np.random.default_rng(count).normal((0.1, -0.2), (0.15, 0.3), (count, 2))
    sums = 5.0 - np.sum((turns[:, None, :] - peaks[None]) ** 2, axis=2)
    peak = find_peak(offsets, sums, np.ones_like(sums))
    mean, sigma = peaks.mean(axis=0), peaks.std(axis=0, ddof=1) / np.sqrt(count)
    assert (peak.pitch_deg, peak.yaw_deg) == pytest.approx(tuple(mean), abs=1e-9)
    assert (peak.sigma_pitch_deg, peak.sigma_yaw_deg) == pytest.approx(tuple(sigma), rel=1e-6)


def axes(roll=(0.0, 0.02), groups=40, **changed):
    peak = {"pitch_deg": 0.0, "yaw_deg": 0.0, "sigma_pitch_deg": 0.0, "sigma_yaw_deg": 0.0, "score": 1.0, "lead": 5.0}
    watched = ScoredDrive("edges", 30, 40, 900, 0.5, 0.3, Peak(**(peak | changed)))
    return {check.axis: check.verdict for check in judge_axes(watched, roll, groups)}


@pytest.mark.parametrize(
    ("changed", "axis", "says"),
    [
        # Student's t of 39 freedoms: 3.13 deviations at 0.01 / 6, 3.93 at 0.001 / 6; 0.055 degrees are one.
        ({"yaw_deg": 3.10 * 0.055}, "yaw", "pass"),
        ({"yaw_deg": -3.16 * 0.055}, "yaw", "look"),
        ({"yaw_deg": 3.90 * 0.055}, "yaw", "look"),
        ({"pitch_deg": 3.97 * 0.055}, "pitch", "stop"),
        # A turn of half a degree must show in nine of ten drives: 3.13 + 1.28 deviations.
        ({"sigma_pitch_deg": np.sqrt(0.1129**2 - 0.055**2)}, "pitch", "pass"),
        ({"sigma_pitch_deg": np.sqrt(0.1139**2 - 0.055**2)}, "pitch", "not_told"),
        ({"roll": (0.5, 0.02)}, "roll", "stop"),
        ({"roll": None}, "roll", "not_told"),
        # The roll's score is that under a pitch that is wrong; where the pitch is only uncertain, it counts.
        ({"roll": (0.5, 0.02), "pitch_deg": 0.6}, "roll", "not_told"),
        ({"roll": (0.5, 0.02), "sigma_pitch_deg": 0.3}, "roll", "stop"),
        ({"lead": 1.9, "yaw_deg": 0.6}, "yaw", "not_told"),
    ],
)
def test_each_axis_has_its_limits(changed, axis, says):
    assert axes(**changed)[axis] == says


def test_few_groups_are_less_sure():
    assert axes(yaw_deg=4.5 * 0.055)["yaw"] == "stop" and axes(yaw_deg=4.5 * 0.055, groups=8)["yaw"] == "look"


def test_the_roll_of_all_groups_is_their_mean_and_an_end_is_none():
    at = np.arange(-2.0, 2.01, 0.05)
    peaks = np.random.default_rng(3).normal(0.3, 0.2, 30)
    sums = 5.0 - (at[:, None] - peaks) ** 2
    turn, sigma = find_roll(at, sums, np.ones_like(sums))
    assert turn == pytest.approx(peaks.mean(), abs=1e-9)
    assert sigma == pytest.approx(peaks.std(ddof=1) / np.sqrt(30), rel=1e-6)
    assert find_roll(at, 5.0 - (at[:, None] - peaks - 3.0) ** 2, np.ones_like(sums)) is None
