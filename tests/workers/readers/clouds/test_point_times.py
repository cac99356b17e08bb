import numpy as np
import pytest
from making_recordings import START_NS, scene

from apexcal.documents.readings import ReadOptions
from workers.readers.clouds.point_times import learn_point_times

PERIOD = 100_000_000


def samples(time_of, count=3):
    columns = scene()
    xyz = np.stack([columns[a] for a in "xyz"], 1).astype(np.float32)
    ring = columns["ring"].astype(np.int32)
    stamps = [START_NS + i * PERIOD for i in range(count)]
    return [(stamp, None if time_of is None else time_of(stamp, columns["time"]), xyz, ring) for stamp in stamps]


def learn(taken, period_ns=PERIOD, **options):
    return learn_point_times(taken, period_ns, ReadOptions(**options), "lidar")


WHOLE, LATE = scene()["time"] * 1e9, scene()["time"] * 1e9 - 1e8
# How a field counts its times; the source, the convention and the offsets that are learned. A double of seconds since
# 1970 resolves 0.24 us.
FIELDS = {
    "seconds after the stamp": (lambda s, t: t.astype(np.float32), "start", WHOLE),
    "seconds before the stamp": (lambda s, t: (t - 0.1).astype(np.float32), "end", LATE),
    "nanoseconds": (lambda s, t: np.rint(t * 1e9).astype(np.uint32), "start", WHOLE),
    "microseconds": (lambda s, t: (t * 1e6).astype(np.float32), "start", WHOLE),
    "absolute seconds": (lambda s, t: s / 1e9 + t, "start", WHOLE),
    "absolute nanoseconds": (lambda s, t: (s + np.rint(t * 1e9).astype(np.int64)).astype(np.uint64), "start", WHOLE),
}


@pytest.mark.parametrize("name", FIELDS)
def test_units_and_bases_are_told_by_the_length_of_a_sweep(name):
    time_of, convention, expected = FIELDS[name]
    taken = samples(time_of)
    times = learn(taken)
    assert (times.source, times.stamp_convention) == ("per_point", convention)
    np.testing.assert_allclose(times.offsets(*taken[1]), expected, atol=500)


def test_a_forward_sector_is_a_part_of_a_turn():
    whole = samples(lambda s, t: t.astype(np.float32))
    ahead = [(s, t[x[:, 0] > 4], x[x[:, 0] > 4], r[x[:, 0] > 4]) for s, t, x, r in whole]
    times = learn(ahead)
    assert (times.source, times.stamp_convention, times.unit_ns) == ("per_point", "start", 1e9)
    assert 0 < len(ahead[0][1]) < len(whole[0][1]) / 3
    np.testing.assert_allclose(times.offsets(*ahead[0]), ahead[0][1].astype(float) * 1e9, atol=10)


def test_times_on_another_clock_count_from_their_first_and_a_field_that_fits_no_unit_is_not_believed():
    taken = samples(lambda s, t: 5000 + t)
    times = learn(taken)
    np.testing.assert_allclose(times.offsets(*taken[0]), WHOLE, atol=500)
    assert "another clock" in " ".join(times.notes)
    times = learn(samples(lambda s, t: np.zeros_like(t)))
    assert times.source == "derived_from_azimuth" and "fits no unit" in " ".join(times.notes)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(("convention", "expected"), [({}, WHOLE), ({"stamp_convention": "end"}, LATE)])
def test_without_a_field_they_follow_the_azimuth_either_way_round(mirrored, convention, expected):
    taken = [(s, t, xyz * np.float32([1, -1 if mirrored else 1, 1]), ring) for s, t, xyz, ring in samples(None)]
    times = learn(taken, **convention)
    assert times.source == "derived_from_azimuth"
    np.testing.assert_allclose(times.offsets(*taken[0]), expected, atol=200)


def test_a_sweep_that_overlaps_itself_keeps_its_two_ends_apart():
    columns = 100
    turn = np.repeat(np.arange(columns) / columns * 1.03, 2) - 0.005  # 371 degrees
    azimuth = -2 * np.pi * turn
    xyz = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], 1).astype(np.float32)
    sweep = (START_NS, None, xyz, np.tile([0, 1], columns).astype(np.int32))
    np.testing.assert_allclose(learn([sweep]).offsets(*sweep), (turn - turn[0]) * 1e8, atol=100)


def test_points_in_no_order_and_those_whose_owner_says_so_have_no_times():
    rng = np.random.default_rng(0)
    shuffled = [(s, t, xyz[p], ring[p]) for s, t, xyz, ring in samples(None) for p in [rng.permutation(len(xyz))]]
    stated = samples(FIELDS["nanoseconds"][0])
    for taken, times in ((shuffled, learn(shuffled)), (stated, learn(stated, point_times="stamp_only"))):
        assert times.source == "stamp_only" and not times.offsets(*taken[0]).any()


def test_an_unusual_pace_of_stamps_is_not_taken_for_the_turn():
    times = learn(samples(None), 2_000_000_000)
    assert times.sweep_ns == PERIOD and "every 2 s" in times.notes[0]
    assert learn(samples(None), None, rate_hz=20).sweep_ns == 50_000_000


def test_one_wild_sweep_is_held_back_and_said():
    taken = samples(FIELDS["seconds after the stamp"][0])
    times = learn(taken)
    stamp, time, xyz, ring = taken[0]
    assert times.offsets(stamp, time + 60, xyz, ring).max() < 2**31
    assert "1 sweeps" in times.warnings()[0]
