"""A pattern's line that was taken for the board's edge is told by what lies as far outside in every frame."""

import numpy as np
import pytest

from tests.workers.marks.test_edges import edges_of, painted
from workers.marks.edges import CornerFit, measure_corner
from workers.marks.outer_edges import changes_outside, outer_distance_m

PX_PER_M = 200.0
ANGLES = (40.0, 140.0)  # of both edges; their angle is 100 degrees
RIM_M = 0.07


def board(seed, outer, inner):
    """A frame of a board whose rim is RIM_M wide, on a texture, and the inner corner's pixel."""
    tip = np.array((118.4, 40.3))
    inner_tip = tip + np.array([0.0, RIM_M * PX_PER_M / np.sin(np.radians(50.0))])
    whole = painted(tuple(tip), ANGLES, outer, 0.8, 1.5, seed, texture=8.0)
    return np.rint(whole + painted(tuple(inner_tip), ANGLES, inner, 0.8, 0.0, seed) - 110.0).astype(
        np.uint8
    ), inner_tip


@pytest.mark.parametrize(("outer", "distance_m"), [(15.0, RIM_M), (-15.0, RIM_M), (0.0, 0.0)])
def test_a_faint_edge_that_all_frames_share_is_the_boards(outer, distance_m):
    changes = []
    for seed in range(12):
        image, inner_tip = board(seed, outer, 60.0)
        edges = edges_of(inner_tip, ANGLES)
        fit = measure_corner(image, edges, 4.0)
        assert isinstance(fit, CornerFit)
        changes.append(changes_outside(image, edges, fit, np.full((2, 2), PX_PER_M)))
    assert outer_distance_m(changes) == pytest.approx(distance_m, abs=0.008)


def test_too_few_frames_tell_nothing():
    rows = np.ones((2, 99))
    rows[:, 40] = 5.0
    assert outer_distance_m([rows] * 3) == 0.0
    assert outer_distance_m([rows] * 5) == pytest.approx(0.1025)
    assert outer_distance_m([]) == 0.0
