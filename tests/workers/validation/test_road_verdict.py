"""The peak of a score over turns, and the verdict on it: how clear, how sure and how far it must be."""

import numpy as np
import pytest

from workers.validation.offsets import Peak, find_peak, turn_grid
from workers.validation.road_verdict import ScoredDrive, judge


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
