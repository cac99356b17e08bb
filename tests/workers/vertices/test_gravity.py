"""Up, as the ground tells or the rig states; boards before sensors that are tilted or upside down."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.scenes.drawn import region_before
from tests.support.scenes.flawed_lidar import Mount
from tests.workers.vertices.refined_walks import SIZE, errors, walk
from workers.simulation.scene import WALKER_REGION
from workers.vertices.detectors import detect_range
from workers.vertices.range_image import open_window
from workers.vertices.region import Region
from workers.vertices.sensor_grid import find_up, learn_grid
from workers.vertices.sweep_source import Listed


def degrees_off(up, mount):
    return np.degrees(np.arccos(np.clip(up @ mount.rotation()[2], -1.0, 1.0)))


@pytest.mark.parametrize("mount", [Mount(roll_deg=20.0), Mount(roll_deg=-12.0, pitch_deg=15.0), Mount(170.0, 8.0)])
def test_the_ground_tells_up(mount):
    up = learn_grid(walk(3, 0.5, mount=mount).sweeps).R_level_lidar[2]
    assert degrees_off(up, mount) < 0.5


def test_a_slope_of_streets_changes_nothing():
    for mount in (Mount(), Mount(roll_deg=2.0, pitch_deg=-2.0)):
        assert (learn_grid(walk(3, 0.5, mount=mount).sweeps).R_level_lidar == np.eye(3)).all()


def test_without_ground_up_is_z_or_what_is_stated():
    nothing = np.zeros((0, 3)), np.zeros(0, np.int64)
    assert find_up(*nothing).tolist() == [0.0, 0.0, 1.0]
    np.testing.assert_allclose(find_up(*nothing, np.array([0.0, 2.0, -2.0])), [0.0, 0.5**0.5, -(0.5**0.5)])


def test_a_ceiling_is_no_ground():
    random = np.random.default_rng(1)
    flat = random.uniform(-12.0, 12.0, (3000, 2))
    xyz = np.column_stack([flat, np.where(random.random(3000) < 0.4, -1.2, 1.6)])
    ring = random.integers(0, 16, 3000)
    assert find_up(xyz, ring)[2] == 1.0
    # A sensor under a ceiling that sees the floor too: only the rig can tell.
    assert find_up(xyz, ring, np.array([0.0, 0.0, -1.0]))[2] == pytest.approx(-1.0)


def test_the_ground_corrects_what_is_stated_but_not_by_more_than_a_mount_leans():
    mount = Mount(roll_deg=20.0)
    sweep = walk(3, 0.5, mount=mount).sweeps[0]
    xyz, ring = sweep.xyz.astype(np.float64), sweep.ring.astype(np.int64)
    assert degrees_off(find_up(xyz, ring, Mount(roll_deg=12.0).rotation()[2]), mount) < 0.5
    stated = Mount(roll_deg=-20.0).rotation()[2]
    np.testing.assert_allclose(find_up(xyz, ring, stated), stated)


@pytest.mark.parametrize("mount", [Mount(roll_deg=180.0), Mount(roll_deg=20.0)], ids=["upside down", "rolled"])
def test_boards_before_a_sensor_that_does_not_stand_upright(mount):
    """Before, the lowest corner was taken for the apex where the sensor hangs upside down."""
    recorded = walk(25, 6.5, mount=mount)
    region = Region.from_document(region_before(mount, -1.85, 32.0))
    found = detect_range(recorded.source, region, "refined", SIZE, indices=recorded.all)
    visible = np.count_nonzero(recorded.rings >= 2)
    wrong, scaled = errors(recorded, found.vertices)
    assert len(found.vertices) > 0.9 * visible
    assert np.sqrt(np.mean(np.sum(wrong[:, :2] ** 2, axis=1))) < 0.09
    assert np.mean(np.abs(scaled) < 2) > 0.9
    for vertex in found.vertices:
        assert abs(vertex.time_ns - recorded.moment_ns[vertex.sweep_index]) < 1_000_000
        assert vertex.roll is not None and abs(np.degrees(vertex.roll[0])) < 20.0


@pytest.mark.parametrize("detector", ["strict", "tolerant"])
def test_the_highest_ring_before_a_sensor_upside_down(detector):
    """Turned by 180 degrees about x with its rings, a sensor of symmetric elevations sees the same."""
    recorded = walk(25, 7.0)
    turned = [
        replace(one, xyz=one.xyz * np.array([1, -1, -1], one.xyz.dtype), ring=(15 - one.ring).astype(one.ring.dtype))
        for one in recorded.sweeps
    ]
    region = Region.from_document(WALKER_REGION)
    upside_down = Region.from_document(region_before(Mount(roll_deg=180.0), -1.85, 32.0))
    found = detect_range(recorded.source, region, detector, indices=recorded.all)
    same = detect_range(Listed(turned), upside_down, detector, indices=recorded.all)
    mirrored = [(one.sweep_index, 15 - one.ring, one.time_ns, -one.xyz[2]) for one in same.vertices]
    assert mirrored == [(one.sweep_index, one.ring, one.time_ns, one.xyz[2]) for one in found.vertices]
    assert len(found.vertices) > 5


def test_a_window_above_a_sensor_on_its_side_has_finite_axes():
    sweep = walk(3, 0.5).sweeps[0]
    grid = learn_grid([sweep], up=np.array([1.0, 0.0, 0.0]))
    assert grid.R_level_lidar[2, 0] == pytest.approx(1.0)
    inside = np.ones(len(sweep.xyz), np.bool_)
    for centre in (0.0, np.pi, 0.3):
        window = open_window(sweep, inside, grid, centre, 0.2)
        np.testing.assert_allclose(window.R_window_lidar @ window.R_window_lidar.T, np.eye(3), atol=1e-12)
        assert all(np.isfinite(part).all() for part in (window.azimuth, window.slope, window.distance))
