"""A chessboard with level edges that is turned and leans: black squares return late or not at all, and walls do."""

import numpy as np
import pytest

from tests.support.scenes.chessboard import EDGES_M, chessboard_poses
from tests.workers.vertices.refined_walks import angles
from workers.vertices.detectors import detect_range
from workers.vertices.region import Region

_REGION = Region.from_document({"all": [{"box": {"min": [1.0, -4.0, -1.0], "max": [7.2, 4.0, 1.6]}}]})


@pytest.mark.parametrize("upper_corner", [1, -1])
def test_the_upper_corners_of_a_turned_chessboard_are_found_and_none_is_wrong_for_its_deviation(upper_corner):
    recorded = chessboard_poses(0, 12)
    true = recorded.left if upper_corner == 1 else recorded.right
    options = {"board_width_m": EDGES_M[0], "board_height_m": EDGES_M[1], "upper_corner": upper_corner}
    found = detect_range(recorded.source, _REGION, "refined", options, indices=range(12), still=True)
    assert len(found.vertices) >= 10
    for vertex in found.vertices:
        off = (angles(vertex.xyz) - angles(true[vertex.sweep_index]))[0, :2]
        assert off @ np.linalg.solve(np.array(vertex.covariance)[:2, :2], off) < 18.0  # chi-square: by chance 0.0001
