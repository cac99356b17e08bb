import numpy as np

from workers.readers.clouds.rings import learn_rings


def points(elevation_of_id, ids, rng, n=400):
    ring = rng.choice(ids, n)
    azimuth = rng.uniform(-np.pi, np.pi, n)
    elevation = np.radians(np.array([elevation_of_id[i] for i in ring]))
    distance = rng.uniform(1, 50, n)
    xyz = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1)
    return (distance[:, None] * xyz).astype(np.float32), ring.astype(np.int64)


def test_ascending_ids_are_kept_with_their_gaps():
    rng = np.random.default_rng(0)
    order = learn_rings([points({i: -15 + 2 * i for i in range(16)}, [3, 4, 9, 15], rng)])
    np.testing.assert_array_equal(order.number(np.array([3, 4, 9, 15, 0])), [3, 4, 9, 15, 0])
    assert order.count == 16 and order.note == ""


def test_ids_from_the_top_are_turned_round_although_the_topmost_see_only_sky():
    rng = np.random.default_rng(1)
    elevations = {i: 22.5 - 45 * i / 63 for i in range(64)}
    order = learn_rings([points(elevations, list(range(10, 60)), rng, 4000)])
    np.testing.assert_array_equal(order.number(np.array([63, 10, 59, 0])), [0, 53, 4, 63])
    assert order.count == 64 and "from the top" in order.note


def test_laser_ids_are_ranked_by_elevation_over_all_samples():
    # VLP-16: laser 0 looks at -15 degrees, 1 at +1, 2 at -13, ...
    elevations = {i: (-15 + i if i % 2 == 0 else i) for i in range(16)}
    rng = np.random.default_rng(2)
    order = learn_rings([points(elevations, range(8), rng), points(elevations, range(8, 16), rng)])
    ids = np.arange(16)
    np.testing.assert_array_equal(order.number(ids), np.argsort(np.argsort([elevations[i] for i in ids])))
    assert "do not follow elevation" in order.note


def test_an_unknown_id_is_no_ring():
    rng = np.random.default_rng(3)
    order = learn_rings([points({i: -15 + 2 * i for i in range(16)}, range(16), rng)])
    np.testing.assert_array_equal(order.number(np.array([2, 999, 15])), [2, -1, 15])


def test_no_points_at_all():
    order = learn_rings([(np.zeros((0, 3), np.float32), np.zeros(0, np.int64))])
    assert order.number(np.zeros(0, np.uint16)).shape == (0,)
