"""Numbers that are no rings are refused; rings of tilted, noisy or damaged clouds are not."""

import numpy as np
import pytest

from tests.support.scenes.flawed_lidar import FlawedLidar, Mount
from workers.readers.clouds.ring_spread import check_rings
from workers.readers.recording import ReadError
from workers.simulation.scene import Scene
from workers.simulation.sensors import SENSORS
from workers.simulation.walker import Walk


def livox(seed, count=20_000, lines=6):
    """A rosette: each line draws petals all over the field."""
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.uniform(0.0, 0.02, count))
    radius = np.radians(35.0) * np.sin(3.618 * angle)
    azimuth, elevation = radius * np.cos(angle), radius * np.sin(angle)
    distance = rng.uniform(3.0, 30.0, count)
    flat = distance * np.cos(elevation)
    xyz = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation)])
    return xyz.astype(np.float32), np.arange(count) % lines


def test_a_livox_s_lines_are_no_rings():
    with pytest.raises(ReadError) as caught:
        check_rings([livox(1), livox(2)], "/livox/lidar", "line")
    assert caught.value.code == "points_without_rings"
    assert "/livox/lidar" in caught.value.message and "Livox" in caught.value.hint


@pytest.mark.parametrize("sensor", ["vlp16", "os0-128", "qt64", "alpha-prime", "lux4"])
@pytest.mark.parametrize("mount", [Mount(), Mount(15.0, 20.0)])
def test_rings_are_rings_also_of_a_cloud_that_was_tilted_or_damaged(sensor, mount):
    walk = Walk(1, 5.0, Scene().ground_z)
    lidar = FlawedLidar(SENSORS[sensor], Scene(), walk, sector_deg=60.0, noise_m=0.02, seed=1)
    clouds = [
        ((cloud.xyz @ mount.rotation().T + 0.5).astype(np.float32), cloud.ring.astype(np.int64))
        for cloud in (lidar.sweep(k, 0.1 * k, 0) for k in range(2))
    ]
    check_rings(clouds, "L", "ring")
    if sensor == "vlp16":
        ring = clouds[0][1]
        ring[::5] = np.random.default_rng(1).integers(0, 16, len(ring[::5]))
        check_rings(clouds[:1], "L", "ring")


def room(center, yaw_deg, pitch_deg=0.0, elevations=np.arange(-15, 16, 2.0), columns=360, seed=0):
    """Points (N, 3) and rings of a sensor in a room of 12 x 9 m, in the vehicle's axes, firing by firing."""
    azimuth = -2 * np.pi * (np.arange(columns) + np.random.default_rng(seed).random()) / columns
    A, E = np.meshgrid(azimuth, np.radians(elevations), indexing="ij")
    ray = np.stack([np.cos(E) * np.cos(A), np.cos(E) * np.sin(A), np.sin(E)], -1).reshape(-1, 3)
    yaw, pitch = np.radians([yaw_deg, pitch_deg])
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    lean = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    ray = ray @ (turn @ lean).T
    with np.errstate(divide="ignore"):
        walls = np.stack([((np.sign(ray[:, i]) * half) - center[i]) / ray[:, i] for i, half in ((0, 6.0), (1, 4.5))])
        floor = np.where(ray[:, 2] < 0, -center[2] / ray[:, 2], np.inf)
    distance = np.minimum(walls.min(0), floor)
    ring = np.tile(np.arange(len(elevations)), columns)
    return (np.array(center) + ray * distance[:, None]).astype(np.float32), ring.astype(np.int64)


def merged(*sensors):
    return np.concatenate([xyz for xyz, _ in sensors]), np.concatenate([ring for _, ring in sensors])


PAIR = (room((1.2, 0.6, 1.4), 40.0, seed=1), room((1.2, -0.6, 1.4), -40.0, 6.0, seed=2))
MERGED = {
    "two of 16 rings, one leaning": merged(*PAIR),
    "two level ones side by side": merged(room((0.5, 0.8, 1.5), 0.0, seed=1), room((0.5, -0.8, 1.5), 90.0, seed=2)),
    "front and rear": merged(room((2.5, 0.0, 0.7), 0.0, 8.0, seed=1), room((-2.0, 0.1, 1.9), 180.0, -3.0, seed=2)),
    "three": merged(*PAIR, room((-1.5, 0.0, 1.0), 180.0, -4.0, seed=3)),
    "four": merged(*PAIR, room((-1.5, 0.0, 1.0), 180.0, -4.0, seed=3), room((0.0, 0.0, 2.0), 10.0, 1.0, seed=4)),
    "of 16 and of 32 rings": merged(PAIR[0], room((0.0, 0.0, 2.0), 0.0, elevations=np.linspace(-25, 15, 32), seed=2)),
}


@pytest.mark.parametrize("name", MERGED)
def test_one_cloud_of_several_sensors_is_named_as_that(name):
    with pytest.raises(ReadError) as caught:
        check_rings([MERGED[name]], "/concatenated", "ring")
    assert caught.value.code == "cloud_merged" and "each LiDAR's own driver" in caught.value.hint
    assert "Livox" not in caught.value.message + caught.value.hint


def test_a_single_sensor_in_the_vehicle_s_frame_is_not_merged():
    """Its neighbours jump at a hedge's leaves, by azimuth and in the file alike."""
    xyz, ring = room((1.2, 0.6, 1.4), 40.0, 6.0)
    check_rings([(xyz, ring)], "L", "ring")
    leaves = np.random.default_rng(0).uniform(0.6, 1.0, len(xyz))[:, None]
    center = np.array([1.2, 0.6, 1.4], np.float32)
    is_hedge = xyz[:, 1] > 2.0
    check_rings(
        [(np.where(is_hedge[:, None], center + (xyz - center) * leaves, xyz).astype(np.float32), ring)], "L", "ring"
    )
