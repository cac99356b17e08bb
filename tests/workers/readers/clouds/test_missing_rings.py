"""Rings of files that have none: by elevation, or by the order of the points."""

import numpy as np
import pytest
from making_recordings import scattered

from workers.readers.clouds.rings import learn_missing_rings
from workers.readers.recording import ReadError

VLP32C = np.array(
    [
        *(-25, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4, -3.667, -3.333, -3, -2.667, -2.333, -2),
        *(-1.667, -1.333, -1, -0.667, -0.333, 0, 0.333, 0.667, 1, 1.333, 1.667, 2.333, 3.333, 4.667, 7, 10.333, 15),
    ]
)


def cloud(elevations, seed, *, rings=None, focus_m=0.0, noise_deg=0.0, near_m=1.0, count=20_000):
    """Points of beams that all pass a point ``focus_m`` from the axis; with the ring of each."""
    rng = np.random.default_rng(seed)
    ring = rng.choice(np.arange(len(elevations)) if rings is None else rings, count)
    elevation = np.radians(elevations[ring] + rng.normal(0, noise_deg, count))
    azimuth = rng.uniform(-np.pi, np.pi, count)
    distance = rng.uniform(near_m, 40, count)
    flat = distance * np.cos(elevation) + focus_m
    xyz = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation)], 1)
    return xyz.astype(np.float32), ring


@pytest.mark.parametrize("count", [4, 16, 32, 64, 128])
@pytest.mark.parametrize("noise_deg", [0.0, 0.01])
def test_evenly_spaced_rings(count, noise_deg):
    elevations = np.linspace(-24.3, 14.1, count)
    samples = [cloud(elevations, seed, noise_deg=noise_deg) for seed in range(3)]
    rings = learn_missing_rings([xyz for xyz, _ in samples], "lidar")
    assert rings.count == count and f"{count} were computed" in rings.note
    for xyz, ring in [*samples, cloud(elevations, 9, noise_deg=noise_deg)]:
        np.testing.assert_array_equal(rings.number(xyz), ring)


@pytest.mark.parametrize(
    ("elevations", "name"),
    [(np.linspace(-15, 15, 16), "a VLP-16"), (np.linspace(-92 / 3, 32 / 3, 32), "an HDL-32E"), (VLP32C, "a VLP-32C")],
)
def test_known_sensors_whose_lowest_and_highest_rings_see_nothing(elevations, name):
    seen = np.arange(2, len(elevations) - 3)
    xyz, ring = cloud(elevations, 1, rings=seen)
    rings = learn_missing_rings([xyz], "lidar")
    assert rings.count == len(elevations) and name in rings.note
    np.testing.assert_array_equal(rings.number(xyz), ring)


def test_an_empty_ring_of_an_even_grid_keeps_its_number():
    elevations = np.linspace(-22.5, 22.5, 64)
    xyz, ring = cloud(elevations, 1, rings=np.delete(np.arange(64), [3, 17, 18, 40]))
    rings = learn_missing_rings([xyz], "lidar")
    assert rings.count == 64 and "4 with few points or none" in rings.note
    np.testing.assert_array_equal(rings.number(xyz), ring)
    partial, ring = cloud(elevations, 2, rings=np.arange(10, 20), count=200)
    np.testing.assert_array_equal(rings.number(partial), ring)


UNEVEN = np.concatenate([np.linspace(-24, -6, 16), np.linspace(-5.5, 3, 18), [4.2, 5.7, 8.0, 11.0]])


@pytest.mark.parametrize("elevations", [np.linspace(-24.3, 14.1, 38), UNEVEN], ids=["even", "uneven"])
def test_rings_of_few_points(elevations):
    """The upper rings see a pole or two, the others walls and the ground."""
    weights = np.concatenate([np.full(34, 1.0), [0.1, 0.03, 0.01, 0.005]])
    rings = np.repeat(np.arange(38), (2000 * weights).astype(int))
    samples = [cloud(elevations, seed, rings=rings) for seed in range(4)]
    learned = learn_missing_rings([xyz for xyz, _ in samples], "lidar")
    assert learned.count == 38
    for xyz, ring in samples:
        np.testing.assert_array_equal(learned.number(xyz), ring)


@pytest.mark.parametrize("focus_m", [0.0414, 0.0158, -0.02])
def test_beams_that_do_not_pass_the_origin(focus_m):
    """Seen from the origin, points of one ring at 0.5 m and at 40 m lie degrees apart."""
    elevations = np.linspace(-24.3, 20.1, 64)
    xyz, ring = cloud(elevations, 1, focus_m=focus_m, near_m=0.5, count=40_000)
    rings = learn_missing_rings([xyz], "lidar")
    assert rings.count == 64
    np.testing.assert_array_equal(rings.number(xyz), ring)


def test_points_between_rings_belong_to_none():
    xyz, _ = cloud(np.linspace(-15, 15, 16), 1)
    rings = learn_missing_rings([xyz], "lidar")
    odd = np.radians(np.array([-14.0, 0.0, 15.9, -16.2, 80.0]))
    assert (rings.number(np.stack([np.cos(odd), 0 * odd, np.sin(odd)], 1).astype(np.float32)) == -1).all()


def test_an_expected_number():
    xyz, ring = cloud(np.linspace(-24.3, 14.1, 32), 1)
    assert learn_missing_rings([xyz], "lidar", 32).count == 32
    more = learn_missing_rings([xyz], "lidar", 40)
    assert more.count == 40 and "40 were expected" in more.note
    np.testing.assert_array_equal(more.number(xyz), ring)
    with pytest.raises(ReadError, match="32 elevations; 16") as caught:
        learn_missing_rings([xyz], "lidar", 16)
    assert caught.value.code == "rings_unexpected" and "32" in caught.value.hint


def tilted(xyz):
    """Points moved into a vehicle's frame: turned by 10 degrees and lifted."""
    s, c = np.sin(0.17), np.cos(0.17)
    return (xyz @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + [0, 0, 1.7]).astype(np.float32)


@pytest.mark.parametrize(
    "points",
    [
        np.stack([scattered()[axis] for axis in "xyz"], 1).astype(np.float32),
        tilted(cloud(np.linspace(-15, 15, 16), 1)[0]),
        cloud(np.linspace(-15, 15, 128), 1, noise_deg=0.08)[0],
        cloud(np.array([3.0]), 1)[0],
        np.zeros((0, 3), np.float32),
        np.ones((3, 3), np.float32),
    ],
    ids=["scattered", "tilted", "noisy", "one ring", "none", "three points"],
)
def test_what_does_not_separate_is_refused_with_what_was_measured(points):
    with pytest.raises(ReadError) as caught:
        learn_missing_rings([points], "/points")
    error = caught.value
    assert error.code == "rings_not_separable" and "/points" in error.message and "PointXYZIR" in error.hint
    assert "degrees" in error.message or "anywhere" in error.message


def hdl64(seed, *, columns=700, drop=0.1, empty=(), direction=1, cut=0.0, sky=False):
    """A sweep in KITTI's order, ring after ring from the top, of two blocks of lasers 6 cm apart; with its rings."""
    rng = np.random.default_rng(seed)
    elevations = np.radians(np.concatenate([np.linspace(2, -8.33, 32), np.linspace(-8.83, -24.33, 32)]))
    heights = np.repeat([0.21, 0.15], 32)
    phases = rng.uniform(0, 6.28, 2)
    points, rings = [], []
    for k in range(64):
        azimuth = cut + np.arange(columns) * 2 * np.pi / columns + rng.normal(0, 2e-5, columns)
        wall = 15 + 8 * np.sin(3 * azimuth + phases[0]) + 4 * np.sin(7 * azimuth + phases[1])
        ground = (1.53 + heights[k]) / max(np.sin(-elevations[k]), 1e-3)
        distance = np.minimum(wall / np.cos(elevations[k]), ground) + rng.normal(0, 0.01, columns)
        seen = (rng.random(columns) > drop) & (k not in empty)
        seen &= ~(sky & (k < 4) & (np.mod(azimuth - cut, 2 * np.pi) < 2))
        flat = distance * np.cos(elevations[k])
        z = distance * np.sin(elevations[k]) + heights[k]
        points.append(np.stack([flat * np.cos(azimuth), direction * flat * np.sin(azimuth), z], 1)[seen])
        rings.append(np.full(np.count_nonzero(seen), 63 - k))
    return np.concatenate(points).astype(np.float32), np.concatenate(rings)


@pytest.mark.parametrize(("direction", "cut"), [(1, 0.0), (-1, np.pi)])
def test_the_order_in_a_file_tells_rings_whose_elevations_overlap(direction, cut):
    how = {"direction": direction, "cut": cut}
    samples = [hdl64(seed, empty=() if seed % 3 else (5,), sky=seed % 2 == 0, **how) for seed in range(4)]
    rings = learn_missing_rings([xyz for xyz, _ in samples], "velodyne_points")
    assert rings.count == 64 and "order of its points" in rings.note
    others = [hdl64(77, empty=(0, 1, 2, 40), **how), hdl64(78, drop=0.5, **how), hdl64(79, sky=True, **how)]
    for xyz, ring in [*samples, *others]:
        assert np.mean(rings.number(xyz) != ring) < 0.001
        assert np.mean(rings.number(xyz[::3]) != ring[::3]) < 0.003
    assert rings.number(np.zeros((0, 3), np.float32)).shape == (0,)


def test_shuffled_points_of_overlapping_rings_are_refused():
    xyz, _ = hdl64(1)
    with pytest.raises(ReadError) as caught:
        learn_missing_rings([np.random.default_rng(0).permutation(xyz)], "velodyne_points")
    assert caught.value.code == "rings_not_separable"


@pytest.mark.parametrize("expected", [None, 16])
def test_a_file_that_lists_firing_after_firing_gives_every_ring(expected):
    """Every second point of it would be of every second ring."""
    elevation, azimuth = np.meshgrid(np.radians(np.arange(-15.0, 16.0, 2.0)), np.radians(np.arange(-50, 50, 0.2)))
    direction = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    ).reshape(-1, 3)
    random = np.random.default_rng(1)
    clouds = [(direction * random.uniform(4.0, 30.0, (len(direction), 1))).astype(np.float32) for _ in range(30)]
    rings = learn_missing_rings(clouds, "topic /points", expected)
    assert rings.count == 16
    np.testing.assert_array_equal(rings.number(clouds[0]), np.tile(np.arange(16), len(direction) // 16))
