import numpy as np
import pytest

from workers.readers.clouds.rings import learn_rings
from workers.readers.recording import ReadError


def points(elevation_of_id, ids, rng, n=400):
    ring = rng.choice(ids, n)
    azimuth = rng.uniform(-np.pi, np.pi, n)
    elevation = np.radians(np.array([elevation_of_id[i] for i in ring]))
    distance = rng.uniform(1, 50, n)
    xyz = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1)
    return (distance[:, None] * xyz).astype(np.float32), ring.astype(np.int64)


def test_ascending_ids_are_kept_with_their_gaps():
    rng = np.random.default_rng(0)
    order = learn_rings([points({i: -15 + 2 * i for i in range(16)}, [3, 4, 9, 15], rng)], "The LiDAR")
    np.testing.assert_array_equal(order.number(np.array([3, 4, 9, 15, 0])), [3, 4, 9, 15, 0])
    assert order.count == 16 and order.note == ""


def test_ids_that_are_no_numbers_are_unknown():
    ids = np.array([0.0, np.nan, 1e30, np.inf, 15.0, -3.0], np.float32)
    rng = np.random.default_rng(0)
    order = learn_rings([points({i: -15 + 2 * i for i in range(16)}, range(16), rng)], "The LiDAR")
    np.testing.assert_array_equal(order.number(ids), [0, -1, -1, -1, 15, -1])


def test_ids_from_the_top_are_turned_round_although_the_topmost_see_only_sky():
    rng = np.random.default_rng(1)
    elevations = {i: 22.5 - 45 * i / 63 for i in range(64)}
    order = learn_rings([points(elevations, list(range(10, 60)), rng, 4000)], "The LiDAR")
    np.testing.assert_array_equal(order.number(np.array([63, 10, 59, 0])), [0, 53, 4, 63])
    assert order.count == 64 and "from the top" in order.note


def test_laser_ids_are_ranked_by_elevation_over_all_samples():
    # VLP-16: laser 0 looks at -15 degrees, 1 at +1, 2 at -13, ...
    elevations = {i: (-15 + i if i % 2 == 0 else i) for i in range(16)}
    rng = np.random.default_rng(2)
    order = learn_rings([points(elevations, range(8), rng), points(elevations, range(8, 16), rng)], "The LiDAR")
    ids = np.arange(16)
    np.testing.assert_array_equal(order.number(ids), np.argsort(np.argsort([elevations[i] for i in ids])))
    assert "do not follow elevation" in order.note


def test_an_unknown_id_is_no_ring():
    rng = np.random.default_rng(3)
    order = learn_rings([points({i: -15 + 2 * i for i in range(16)}, range(16), rng)], "The LiDAR")
    np.testing.assert_array_equal(order.number(np.array([2, 999, 15])), [2, -1, 15])


def test_no_points_at_all():
    order = learn_rings([(np.zeros((0, 3), np.float32), np.zeros(0, np.int64))], "The LiDAR")
    assert order.number(np.zeros(0, np.uint16)).shape == (0,)


EVEN = {i: -15 + 2 * i for i in range(16)}


@pytest.mark.parametrize("rings", [16, 12])
@pytest.mark.parametrize(("wild", "elevation"), [(40_000, -16), (300, 20), (16, -15.5), (20, 40)])
def test_a_damaged_point_is_no_ring(rings, wild, elevation):
    rng = np.random.default_rng(4)
    clouds = [points(EVEN, range(rings), rng, 2000), points({wild: elevation}, [wild], rng, 1)]
    order = learn_rings(clouds, "The LiDAR")
    np.testing.assert_array_equal(order.number(np.array([*range(16), wild])), [*range(16), -1])
    assert (order.count, order.note) == (16, "")


def test_a_damaged_point_in_every_sweep_is_no_ring():
    rng = np.random.default_rng(5)
    order = learn_rings([points(EVEN, range(16), rng, 40_000), points({65_534: 20}, [65_534], rng, 20)], "The LiDAR")
    assert order.count == 16 and order.number(np.array([65_534])) == -1


def test_a_damaged_point_among_the_unseen_rings_does_not_renumber_the_others():
    rng = np.random.default_rng(6)
    order = learn_rings([points(EVEN, range(12), rng, 2000), points({14: -16}, [14], rng, 1)], "The LiDAR")
    np.testing.assert_array_equal(order.number(np.arange(16)), np.arange(16))


def test_a_top_ring_that_saw_one_point_keeps_its_number():
    rng = np.random.default_rng(7)
    order = learn_rings([points(EVEN, range(10), rng, 2000), points(EVEN, [15], rng, 1)], "The LiDAR")
    assert order.number(np.array([15])) == 15 and order.note == ""


def test_ids_that_no_sensor_has_are_refused():
    rng = np.random.default_rng(8)
    elevations = {100 * i: -15 + 2 * i for i in range(16)}
    with pytest.raises(ReadError, match="ring ids up to 1500") as caught:
        learn_rings([points(elevations, list(elevations), rng, 2000)], "The LiDAR")
    assert caught.value.code == "rings_too_many" and caught.value.hint
