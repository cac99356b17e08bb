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
        check_rings([livox(1), livox(2)], "/livox/lidar")
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
    check_rings(clouds, "L")
    if sensor == "vlp16":
        ring = clouds[0][1]
        ring[::5] = np.random.default_rng(1).integers(0, 16, len(ring[::5]))
        check_rings(clouds[:1], "L")
