"""What stands still is no board: fixed objects of a walk, and upright rectangles of a short recording."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.detection.drawn import run_street
from tests.workers.vertices.refined_walks import REGION, walk
from workers.vertices.detectors import without_fixed
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


def test_a_sign_of_the_size_of_a_level_board_is_none():
    # 0.66 x 0.88 m, 21 m away. In six sweeps 7 to 13 of its returns do not count as static.
    assert run_street((9612, 1)) == 0
