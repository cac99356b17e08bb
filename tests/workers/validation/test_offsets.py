"""The peak of a score over turns, and its deviation, where both are exact: a group's score is a paraboloid."""

import numpy as np
import pytest

from workers.validation.offsets import find_peak, turn_grid


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
