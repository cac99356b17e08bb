"""The detection benchmark: what is true of a drawn walk, and figures that show what went wrong."""

import numpy as np
import pytest

from benchmarks.detection.walks import found, looked_at
from tests.support.scenes.drawn import draw
from workers.simulation.beams import BOARD
from workers.vertices.region import Region


@pytest.mark.parametrize("seed", [2, 4, 5])
def test_the_true_apex_is_where_the_sensor_saw_it(seed):
    """No point of the board is higher than the apex by more than beam, noise and errors of angles."""
    drawn = draw(seed)
    walk, lidar = drawn.simulated(1.0)
    walked = looked_at(walk, lidar, 0.6)
    up = drawn.mount.rotation()[2]
    for index, (sweep, apex) in enumerate(zip(walked.sweeps, walked.apexes, strict=True)):
        _, label = lidar.labelled_sweep(index, index / drawn.sensor.rate_hz, 0)
        board = sweep.xyz[label == BOARD]
        assert len(board) > 10
        below = (apex - board) @ up
        assert -0.06 < below.min() < 0.35
        assert np.unique(sweep.ring[label == BOARD]).size == walked.rings[index]


def test_a_vertex_is_judged_at_the_moment_that_it_states():
    """Half of the lasers look 11 degrees aside of the others: at the seam, they see the board a turn apart."""
    drawn = draw(10001)
    assert drawn.sensor.name == "qt64"
    walked = looked_at(*drawn.simulated(1.6), 1.6)
    azimuth = np.degrees(np.arctan2(walked.apexes[:, 1], walked.apexes[:, 0]))
    assert np.abs(azimuth - drawn.mount.seam_deg).min() < 2.0
    size = {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1]}
    seen = found(walked, Region.from_document(drawn.region()), "refined", size)
    assert len(seen.vertices) >= 6
    assert np.hypot(*seen.vertices[:, :2].T).max() < 0.2
