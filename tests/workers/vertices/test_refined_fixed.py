"""What stands still is no board: fixed objects of a walk, and upright rectangles of a short recording."""

from dataclasses import replace

import numpy as np
import pytest

from tests.workers.vertices.refined_walks import REGION, SIZE, walk
from workers.simulation.drawn import draw_street
from workers.vertices.detectors import detect_range
from workers.vertices.fixed_objects import without_fixed
from workers.vertices.region import Region
from workers.vertices.sweep_source import Listed

_WALL = ((7.0, 1.5), (7.0, 3.5))  # x and y of its ends, metres


@pytest.fixture(scope="module")
def recorded():
    return walk(27, 8.0)


def with_wall(sweep):
    """The sweep with returns of a wall where its rays meet it, whatever they met before."""
    x, y, _ = sweep.xyz.T
    times = _WALL[0][0] / np.maximum(x, 0.1)
    met = (x > 0.1) & (y * times > _WALL[0][1]) & (y * times < _WALL[1][1])
    xyz = np.where(met[:, None], sweep.xyz * times[:, None], sweep.xyz).astype(np.float32)
    return replace(sweep, xyz=xyz), met


def test_a_wall_is_left_out_of_a_walk_and_the_walker_is_not(recorded):
    pairs = [with_wall(recorded.source.sweep(k)) for k in recorded.all]
    source = Listed([sweep for sweep, _ in pairs])
    area = without_fixed(source, REGION)
    assert area.fixed_left_out
    of_wall, of_walker = [], []
    for sweep, met in pairs[::10]:
        before, after = REGION.inside(sweep), area.inside(sweep)
        assert not (after & ~before).any()
        of_wall.append(after[before & met])
        of_walker.append(after[before & ~met])
    assert np.concatenate(of_wall).mean() < 0.05
    assert np.concatenate(of_walker).mean() > 0.5


def test_too_short_a_recording_tells_nothing_of_what_stands_still(recorded):
    short = Listed([recorded.source.sweep(k) for k in range(30)])
    assert without_fixed(short, REGION) is REGION
    assert not REGION.fixed_left_out


# A wall's end with the board's size: before, each street gave a vertex. In the second its returns contradict a board.
@pytest.mark.parametrize(("seed", "reason"), [(19, "upright_object"), (23, "not_a_board")])
def test_a_few_sweeps_of_a_street_give_no_board(seed, reason):
    drawn = draw_street(seed)
    _, lidar = drawn.simulated(1.0)
    rate = lidar.sensor.rate_hz
    source = Listed([lidar.sweep(k, k / rate, round(k / rate * 1e9)) for k in range(5)])
    size = {"board_width_m": drawn.board_m[0], "board_height_m": drawn.board_m[1]}
    found = detect_range(source, Region.from_document(drawn.region()), "refined", size, indices=range(5))
    assert not found.vertices
    assert found.rejected[reason] >= 1


def test_a_few_sweeps_of_a_near_board_still_give_it(recorded):
    first = int(np.argmin(np.linalg.norm(recorded.apex[:70], axis=1)))
    sweeps = [recorded.source.sweep(k) for k in range(first, first + 8)]
    found = detect_range(Listed(sweeps), REGION, "refined", SIZE, indices=range(8))
    assert len(found.vertices) >= 4
