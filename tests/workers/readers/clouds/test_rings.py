import numpy as np
import pytest

from workers.readers.clouds.rings import learn_rings
from workers.readers.recording import ReadError

EVEN = {i: -15 + 2 * i for i in range(16)}


def points(elevation_of_id, ids, n=400, seed=0):
    rng = np.random.default_rng(seed)
    ring = rng.choice(ids, n)
    azimuth = rng.uniform(-np.pi, np.pi, n)
    elevation = np.radians(np.array([elevation_of_id[i] for i in ring]))
    distance = rng.uniform(1, 50, n)
    xyz = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1)
    return (distance[:, None] * xyz).astype(np.float32), ring.astype(np.int64)


def learned(*clouds):
    return learn_rings(list(clouds), "The LiDAR")


NOTHING = (np.zeros((0, 3), np.float32), np.zeros(0, np.int64))
DOWN = {i: 22.5 - 45 * i / 63 for i in range(64)}
# VLP-16: laser 0 looks at -15 degrees, 1 at +1, 2 at -13, ...
LASERS = {i: (-15 + i if i % 2 == 0 else i) for i in range(16)}
RANKED = np.argsort(np.argsort(list(LASERS.values()))).tolist()


@pytest.mark.parametrize(
    ("clouds", "numbers", "count", "note"),
    [
        # Ascending ids are kept with their gaps; what is no number, or no sample had, is no ring.
        ([points(EVEN, [3, 4, 9, 15])], {3: 3, 4: 4, 9: 9, 15: 15, 0: 0}, 16, None),
        ([points(EVEN, range(16))], {0: 0, np.nan: -1, 1e30: -1, np.inf: -1, 15: 15, -3: -1, 999: -1}, 16, None),
        # Ids from the top are turned round although the topmost see only sky; laser ids are ranked over all samples.
        ([points(DOWN, range(10, 60), 4000)], {63: 0, 10: 53, 59: 4, 0: 63}, 64, "from the top"),
        ([points(LASERS, range(8)), points(LASERS, range(8, 16))], dict(enumerate(RANKED)), 16, "do not follow"),
        # A damaged point is no ring, also in every sweep or among unseen rings, and a top ring of one point is one.
        *(([points(EVEN, range(rings), 2000), points({wild: up}, [wild], 1)],
           {**{i: i for i in range(16)}, wild: -1}, 16, None)
          for rings in (16, 12) for wild, up in ((40_000, -16), (300, 20), (16, -15.5), (20, 40))),
        ([points(EVEN, range(16), 40_000), points({65_534: 20}, [65_534], 20)], {65_534: -1}, 16, None),
        ([points(EVEN, range(12), 2000), points({14: -16}, [14], 1)], {i: i for i in range(16)}, 16, None),
        ([points(EVEN, range(10), 2000), points(EVEN, [15], 1)], {15: 15}, 16, None),
        ([NOTHING], {}, None, None),
    ],
)  # fmt: skip
def test_ids_become_numbers_from_the_lowest_ring_up(clouds, numbers, count, note):
    order = learned(*clouds)
    np.testing.assert_array_equal(order.number(np.array([*numbers], np.float32)), [*numbers.values()])
    assert count is None or order.count == count
    assert note in order.note if note else order.note == ""


def steady(ids, down=False, sweeps=5):
    """Sweeps that all have the ids, the first at -15 degrees and 1.5 from one to the next; with ``down`` at 15."""
    elevations = {number: (-1 if down else 1) * (-15 + 1.5 * index) for index, number in enumerate(ids)}
    return [points(elevations, list(ids), 4000, seed) for seed in range(sweeps)]


@pytest.mark.parametrize(
    ("ids", "count"),
    [
        *((range(0, 64, 4), 16), (range(1, 17), 16), (range(0, 128, 2), 64), (range(1, 33), 32), (range(16, 32), 16)),
        *((range(3, 67, 4), 16), (range(0, 1600, 100), 16), (range(1000, 1040), 40), (range(200, 232), 32)),
        ([0, 1, 2, 9, 10, 11, 20, 21, 22, 23, 40, 41, 42, 50, 51, 63], 16),  # a selection of a sensor's rings
        (range(2, 16), 16),  # two at the bottom see nothing
        ([*range(17), *range(18, 64)], 64),  # a dead laser leaves its gap
    ],
)
@pytest.mark.parametrize("down", [False, True])
def test_ids_count_by_what_is_there(ids, count, down):
    ids = list(ids)
    order = learned(*steady(ids, down))
    assert order.count == count
    numbers = order.number(np.array(ids)).tolist()
    assert numbers == sorted(set(numbers), reverse=down) and numbers[0 if not down else -1] >= 0
    if len(ids) == count:
        assert sorted(numbers) == list(range(count))
    assert order.number(np.array([5000])).tolist() == [-1]


@pytest.mark.parametrize("down", [False, True])
def test_lowest_ids_of_hardly_any_points_stay_rings(down):
    """Of 40 lasers those that look at the sky see a wire now and then; 32 others are as many as some sensor has."""
    clouds = []
    for xyz, ring in steady(range(40), down, sweeps=4):
        rare = np.array([np.flatnonzero(ring == number)[0] for number in range(8)])
        seen = np.union1d(np.flatnonzero(ring >= 8), rare[len(clouds) :: 4])
        clouds.append((xyz[seen], ring[seen]))
    numbers = learned(*clouds).number(np.arange(40)).tolist()
    assert min(numbers) >= 0 and numbers == sorted(set(numbers), reverse=down)


def test_rings_that_come_and_go_in_cropped_clouds_keep_their_ids():
    clouds = [points(EVEN, ids, 400, seed) for seed, ids in enumerate(([4, 5, 8], [5, 6], [8, 9, 10], [4, 12]))]
    order = learned(*clouds)
    assert order.count == 16 and order.number(np.arange(16)).tolist() == list(range(16))


def test_ids_that_no_sensor_has_are_refused():
    with pytest.raises(ReadError, match="ring ids up to 299") as caught:
        learned(*steady(range(300), sweeps=1)[:1], *steady(range(300)))
    assert caught.value.code == "rings_too_many" and caught.value.hint


def test_ids_below_0_are_ids():
    """A simulator counts channels from the horizon."""
    clouds = steady(range(-8, 8))
    order = learned(*clouds)
    assert order.count == 16 and "-8, -7, -6 ... 7 were counted as 16 rings" in order.note
    np.testing.assert_array_equal(
        order.number(np.array([-8, 0, 7, -9, 8, np.nan], np.float32)), [0, 8, 15, -1, -1, -1]
    )


def test_minus_1_alone_marks_points_of_no_ring():
    order = learned(*(points({**EVEN, -1: 5}, range(-1, 16), 4000, seed) for seed in range(5)))
    assert order.count == 16 and order.number(np.array([-1, 0, 15])).tolist() == [-1, 0, 15]
