"""The detection benchmark: what is true of a drawn walk, and figures that show what went wrong."""

import numpy as np
import pytest

from benchmarks.detection.drawn import DrawnWalk, drawn_figures
from benchmarks.detection.walks import Found, found, looked_at
from tests.support.scenes.drawn import draw
from workers.simulation.lidar import BOARD
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


def _walk(seed, bias_deg, *, vertices=50, frames=60):
    rows = np.zeros((vertices, 10))
    rows[:, 0] = bias_deg
    rows[:, 3:6], rows[:, 6], rows[:, 7] = 0.01, 10.0, 1.0
    return DrawnWalk(seed, "", Found("drawn", "refined", np.full(frames, 10.0), rows, {"too_uncertain": 10}))


def test_one_walk_that_is_off_shows_among_many():
    figures = drawn_figures([*(_walk(seed, 0.001) for seed in range(9)), _walk(9, 0.05), _walk(10, 2.0, vertices=3)])
    assert figures["worst_bias_deg"] == pytest.approx(0.05)
    assert figures["walks_within_0.015_deg"] == pytest.approx(0.9)
    assert figures["gross_share"] == pytest.approx(3 / 503)
    assert figures["accepted_share"] == pytest.approx(503 / 660)
    assert figures["rejected"] == {"too_uncertain": 110}
    assert figures["each"][9]["coverage"] == pytest.approx(2 / 3)


def test_a_vertex_is_judged_at_the_moment_that_it_states():
    """Half of the lasers look 11 degrees aside of the others: at the seam, they see the board a turn apart."""
    drawn = draw(10001)
    assert drawn.sensor.name == "qt64"
    walked = looked_at(*drawn.simulated(1.6), 1.6)
    azimuth = np.degrees(np.arctan2(walked.apexes[:, 1], walked.apexes[:, 0]))
    assert np.abs(azimuth - drawn.mount.seam_deg).min() < 2.0
    size = {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1]}
    seen = found("drawn", "refined", walked, Region.from_document(drawn.region()), "refined", size)
    assert len(seen.vertices) >= 6
    assert np.hypot(*seen.vertices[:, :2].T).max() < 0.2
