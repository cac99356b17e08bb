"""What a ray beside a board's edge tells, and how much may contradict a board."""

from dataclasses import replace

import numpy as np
import pytest

from tests.workers.vertices.refined_walks import REGION, SIZE, walk
from workers.vertices.board.board_estimate import Contradictions
from workers.vertices.board.candidate_search import find_planes
from workers.vertices.board.estimate import find_boards
from workers.vertices.board.model import BoardModel
from workers.vertices.board.planes import find_segments
from workers.vertices.range_image import RangeImage
from workers.vertices.sensor_grid import learn_grid

STEP = 0.004
RINGS, COLUMNS = 12, 121
MIDDLE = COLUMNS // 2


@pytest.fixture(scope="module")
def near():
    """A board that many rings meet: the sensor's directions, and what one sweep tells of it."""
    sweep = walk(15, 4.0, sensor="os1-64", rings=64).sweeps[0]
    grid = learn_grid([sweep])
    model = BoardModel(grid, edges=(SIZE["board_width_m"], SIZE["board_height_m"]), slack=0.0, blooming=0.5e-3)
    return model, find_boards(sweep, REGION.inside(sweep), model)[0][1]


@pytest.mark.parametrize(
    ("wrong", "against", "explained"), [(0.002, 12, True), (0.002, 13, False), (0.05, 27, True), (0.05, 28, False)]
)
def test_more_may_contradict_a_board_where_this_recordings_boards_are_contradicted_more(
    near, wrong, against, explained
):
    """Likelier by chance: k log(0.5 / w) > 100 log(2 (1 - w)), from k = 12.5 at 0.002, from 27.9 at 0.05."""
    board = near[1]
    assert board.plane.extent.has_many_rings

    def is_consistent(wrong_below, *returns):
        agreement = replace(board.agreement, wrong=(wrong, wrong_below), returns=returns)
        return replace(board, agreement=agreement).is_consistent

    assert is_consistent(wrong, Contradictions(against, 100), Contradictions(0, 0)) is explained
    assert is_consistent(wrong, Contradictions(0, 0), Contradictions(against, 100)) is explained
    # Where a body answers below the side corners, as many contradict nothing there, and above them as much as ever.
    assert is_consistent(0.4, Contradictions(0, 100), Contradictions(against, 100))
    assert is_consistent(0.4, Contradictions(against, 100), Contradictions(0, 0)) is explained


def test_a_ray_without_a_return_beside_a_head_may_have_met_the_board_too(near):
    """Right of the board a head stands 0.3 m behind its plane; left of it there is nothing."""
    column = np.arange(COLUMNS) - MIDDLE
    azimuth, slope, distance = np.zeros((3, RINGS, COLUMNS))
    azimuth += STEP * column
    slope += 0.012 * (np.arange(RINGS) - RINGS // 2)[:, None]
    distance[:, np.abs(column) <= 25] = 5.0
    distance[:, (column < -25) & (column > -32)] = 5.3
    distance /= np.cos(azimuth)
    distance[:, MIDDLE - 27] = 0.0  # the head's dark hair
    inside = distance > 0.0
    point = np.where(inside, np.arange(RINGS * COLUMNS).reshape(RINGS, COLUMNS), -1)
    window = RangeImage(np.eye(3), np.full(RINGS, STEP), np.arange(RINGS), azimuth, slope, distance, inside, point)
    plane = find_planes([window], near[0], 1)[0].plane
    along = np.round(np.arctan2(plane.rays.left, 5.0) / STEP)
    assert plane.rays.is_mixed[(along == -27) & ~plane.rays.has_return].all()
    assert np.count_nonzero((along == -27) & ~plane.rays.has_return) == RINGS
    assert not plane.rays.is_mixed[(along > 25) | (np.abs(along) < 20)].any()


def test_each_return_may_be_a_stretch_of_its_own():
    """A fence or leaves: no two neighbours are at one range. Only the plain function checks its bounds."""
    distance = np.tile([5.0, 7.0], (2, 20))
    azimuth = np.tile(np.radians(0.2) * np.arange(40), (2, 1))
    asked = azimuth, distance, np.ones((2, 40), np.bool_), 0.02, np.full(2, np.radians(0.2))
    found = find_segments.py_func(*asked)
    assert found.shape == (80, 7)
    np.testing.assert_allclose(find_segments(*asked), found)
