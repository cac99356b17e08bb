from dataclasses import replace

import numpy as np
import pytest

from tests.support.scenes.flawed_lidar import Flaws
from tests.workers.vertices.refined_walks import walk
from tests.workers.vertices.sweeps import row, sweep
from workers.simulation.sensors import SENSORS
from workers.vertices.range_image import open_window
from workers.vertices.sensor_grid import learn_grid


def thinned(seen, kept, further=1.0):
    """The returns of these indices, farther by a factor."""
    columns = {name: getattr(seen, name)[kept] for name in ("intensity", "ring", "offset_ns")}
    return replace(seen, xyz=(further * seen.xyz[kept]).astype(np.float32), **columns)


@pytest.mark.parametrize("sensor", ["vlp16", "vlp32c", "os1-64"])
def test_the_grid_of_a_sensor_is_found_from_its_returns(sensor):
    model = SENSORS[sensor]
    grid = learn_grid(walk(3, 0.5, sensor=sensor).sweeps)
    seen = grid.elevation.size
    assert seen <= len(model.elevations_deg)
    assert np.degrees(grid.step) == pytest.approx(model.step_deg, abs=1e-5)
    filled = [np.any(s.ring == ring) for ring in range(seen) for s in walk(3, 0.5, sensor=sensor).sweeps[:1]]
    expected = np.array(model.elevations_deg)[:seen][filled]
    np.testing.assert_allclose(np.degrees(grid.elevation)[filled], expected, atol=1e-3)


def test_the_grids_of_the_rings_lie_as_the_lasers_fire():
    grid = learn_grid(walk(3, 0.5).sweeps)
    # A VLP-16 fires ring 0, 8, 1, 9 ...: 2.304 microseconds, that is 0.0083 degrees, from one to the next.
    later = np.degrees(grid.shift[8] - grid.shift[0]) % 0.2
    assert later == pytest.approx(0.2 - 0.008294, abs=1e-4)


def test_nothing_has_a_grid_too_and_a_ring_without_returns_lies_between_its_neighbours():
    grid = learn_grid([sweep([])])
    assert (grid.elevation.tolist(), grid.shift.tolist()) == ([0.0], [0.0])
    assert (grid.R_level_lidar == np.eye(3)).all() and np.degrees(grid.step) == pytest.approx(0.2)
    elevation = learn_grid([sweep([*row(0, 9), *row(2, 9)])]).elevation
    assert elevation[1] == pytest.approx(0.5 * (elevation[0] + elevation[2]))


def test_a_ring_that_no_sensor_has_takes_no_memory():
    seen = walk(3, 0.5).sweeps[0]
    ring = seen.ring.copy()
    ring[7] = 65_535
    damaged = replace(seen, ring=ring)
    grid = learn_grid([damaged])
    assert grid.elevation.size == int(seen.ring.max()) + 1
    window = open_window(damaged, np.ones(len(ring), np.bool_), grid, float(np.arctan2(*seen.xyz[7, 1::-1])), 0.2)
    assert window.distance.shape[0] == grid.elevation.size and 7 not in window.point


def test_rings_that_fire_half_as_often_have_their_own_step_and_no_false_misses():
    recorded = walk(3, 0.5, sensor="mixed128")
    grid = learn_grid(recorded.sweeps)
    every = np.array(SENSORS["mixed128"].every)[: grid.steps.size]
    filled = np.bincount(np.concatenate([s.ring for s in recorded.sweeps]), minlength=grid.steps.size) > 200
    np.testing.assert_allclose(np.degrees(grid.steps)[filled], 0.1 * every[filled], atol=1e-4)
    seen = recorded.sweeps[0]
    window = open_window(seen, np.ones(len(seen.ring), np.bool_), grid, 0.0, 0.3)
    full = (window.distance > 0.0).sum(axis=1) / (window.azimuth < np.pi).sum(axis=1)
    # The lowest rings meet the ground everywhere: no ray of theirs is missed.
    assert (full[5:20] > 0.97).all()


def test_sparse_returns_do_not_widen_a_rings_step():
    recorded = walk(3, 0.5, sensor="os1-64")
    random = np.random.default_rng(2)
    few = [thinned(s, (s.ring > 20) | (random.random(len(s.ring)) < 0.4)) for s in recorded.sweeps]
    grid = learn_grid(few)
    np.testing.assert_allclose(np.degrees(grid.steps), SENSORS["os1-64"].step_deg, atol=1e-4)


def test_two_kinds_of_gaps_with_nothing_between_them_have_a_step():
    """A quantile between two gaps is no gap, and none may be near: the mean of nothing is no number."""

    def ring(number, *gaps_deg):
        azimuth = np.radians(np.cumsum([0.0, *gaps_deg]))
        return [(number, 5.0 * np.cos(one), 5.0 * np.sin(one), 0.1 * number) for one in azimuth]

    half = learn_grid([sweep([*ring(0, *[0.1] * 20), *ring(1, *[0.4] * 20)])])
    low = learn_grid([sweep([*ring(0, *[0.2] * 200), *ring(1, *[0.4] * 5, *[1.2] * 26)])])
    for grid in (half, low):
        assert np.isfinite(grid.steps).all() and np.isfinite(grid.shift).all()


def test_rings_below_all_that_ever_returned_anything_have_no_rays():
    """Their elevation is not known; taken for that of the next ring, they contradicted every board."""
    recorded = walk(3, 0.5)
    cut = [thinned(s, s.ring >= 4) for s in recorded.sweeps]
    grid = learn_grid(cut)
    assert np.isnan(grid.elevation[:4]).all() and np.isfinite(grid.elevation[4:]).all()
    window = open_window(cut[0], np.ones(len(cut[0].ring), np.bool_), grid, 0.0, 0.2)
    assert (window.azimuth[:4] == np.pi).all() and (window.azimuth[4:] < 1.0).all()


def test_two_returns_of_a_shot_are_one_ray():
    recorded = walk(3, 0.5)
    first = recorded.sweeps[0]
    every = np.arange(len(first.ring))
    both = np.concatenate([every, every[::3]])
    twice = thinned(first, both, np.where(np.arange(len(both)) < len(every), 1.0, 1.2)[:, None])
    alone = learn_grid([first])
    assert learn_grid([twice]).step == pytest.approx(alone.step, rel=1e-6)
    windows = [open_window(s, np.ones(len(s.ring), np.bool_), alone, 0.0, 0.2) for s in (first, twice)]
    np.testing.assert_array_equal(windows[0].distance, windows[1].distance)


def test_shots_without_a_return_lie_where_a_wandering_motor_had_them():
    recorded = walk(3, 0.5, flaws=Flaws(wander_deg=0.3))
    grid = learn_grid(recorded.sweeps)
    seen = recorded.sweeps[2]
    window = open_window(seen, np.ones(len(seen.ring), np.bool_), grid, 0.0, np.radians(30.0))
    row, column = np.nonzero((window.point >= 0) & (np.abs(window.azimuth) < np.radians(29.0)))
    # Each return in turn is taken away: its shot must be known from the others.
    away = np.random.default_rng(1).choice(row.size, 40, replace=False)
    off = []
    for k in away:
        kept = np.arange(len(seen.ring)) != window.point[row[k], column[k]]
        fewer = thinned(seen, kept)
        without = open_window(fewer, np.ones(len(fewer.ring), np.bool_), grid, 0.0, np.radians(30.0))
        off.append(np.abs(without.azimuth[row[k]] - window.azimuth[row[k], column[k]]).min())
    assert np.degrees(max(off)) < 0.02
