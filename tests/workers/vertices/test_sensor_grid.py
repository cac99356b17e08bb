from dataclasses import replace

import numpy as np
import pytest

from tests.workers.vertices.refined_walks import walk
from tests.workers.vertices.sweeps import sweep
from workers.simulation.lidar import SENSORS
from workers.vertices.refined.window import open_window
from workers.vertices.sensor_grid import learn_grid


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


def test_a_sweep_without_points_has_a_grid_too():
    grid = learn_grid([sweep([])])
    assert (grid.elevation.tolist(), grid.shift.tolist()) == ([0.0], [0.0])
    assert np.degrees(grid.step) == pytest.approx(0.2)


def test_a_ring_without_returns_lies_between_its_neighbours():
    points = [(ring, 5.0, 0.02 * i, 0.1 * ring) for ring in (0, 2) for i in range(9)]
    grid = learn_grid([sweep(points)])
    assert grid.elevation[1] == pytest.approx(0.5 * (grid.elevation[0] + grid.elevation[2]))


def test_a_ring_that_no_sensor_has_takes_no_memory():
    seen = walk(3, 0.5).sweeps[0]
    ring = seen.ring.copy()
    ring[7] = 65_535
    damaged = replace(seen, ring=ring)
    grid = learn_grid([damaged])
    assert grid.elevation.size == int(seen.ring.max()) + 1
    window = open_window(damaged, np.ones(len(ring), np.bool_), grid, float(np.arctan2(*seen.xyz[7, 1::-1])), 0.2)
    assert window.distance.shape[0] == grid.elevation.size and 7 not in window.point
