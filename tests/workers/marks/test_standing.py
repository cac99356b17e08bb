"""Boards that hide the same part of the background are told by their places alone."""

import numpy as np

from workers.marks.sights import Sight, is_in_one_place


def sight(index, azimuth_deg, distance_m=5.0):
    azimuth = np.radians(azimuth_deg)
    tip = distance_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.1])
    return Sight(index, {"top": tip}, np.eye(3) * 1e-4)


def test_a_board_that_stays_is_in_one_place_and_one_that_moves_is_not():
    assert is_in_one_place([sight(index, azimuth) for index, azimuth in enumerate([0, 1, 2, 0, 1, 2, 20, 40])])
    assert not is_in_one_place([sight(index, azimuth) for index, azimuth in enumerate([0, 1, 2, 0, 20, 40, 60, 80])])
    assert not is_in_one_place([sight(index, 10.0 * index) for index in range(8)])
