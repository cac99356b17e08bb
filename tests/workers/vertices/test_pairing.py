from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.workers.vertices.walks import START_NS, seconds, spherical, vertices, walk
from workers.vertices.pairing import NO_FRAME_GAP_NS, REACH_NS, on_track, pair, pair_interpolated
from workers.vertices.tracks import MARGIN_SWEEPS

MS = 1_000_000
# Stamps of today, whose nanoseconds a double would lose.
times = st.lists(st.integers(START_NS, START_NS + 2_000 * MS), max_size=30)


@given(times, times, st.integers(-50 * MS, 50 * MS), st.integers(0, 100 * MS))
def test_each_vertex_gets_the_nearest_frame(vertices, frames, offset, max_gap):
    index, gap = pair(vertices, frames, offset_ns=offset, max_gap_ns=max_gap)
    assert index.shape == gap.shape == (len(vertices),)
    for moment, chosen, difference in zip(vertices, index, gap, strict=True):
        if not frames:
            assert (chosen, difference) == (-1, NO_FRAME_GAP_NS)
            continue
        nearest = min(abs(frame - moment - offset) for frame in frames)
        assert abs(difference) == nearest
        assert (chosen >= 0) == (nearest <= max_gap)
        if chosen >= 0:
            assert frames[chosen] - moment - offset == difference


def test_of_two_frames_equally_near_the_earlier_is_taken():
    index, gap = pair([100], [90, 110], max_gap_ns=10)
    assert (index.tolist(), gap.tolist()) == ([0], [-10])


def test_a_negative_limit_is_refused():
    with pytest.raises(ValueError, match="max_gap_ns"):
        pair(np.array([1]), np.array([1]), max_gap_ns=-1)


def test_a_frame_that_people_marked_is_kept_as_far_as_the_track_reaches():
    way = walk(0)
    found = vertices(way, 0)
    frames = START_NS + np.arange(0, 31 * 15) * 66_700_000
    near = {"offset_ns": 0, "max_gap_ns": 34 * MS}
    first = pair_interpolated(found, frames, **near)
    again = pair_interpolated(found, frames, **near | {"offset_ns": 45 * MS}, marked=first.index)
    np.testing.assert_array_equal(again.index, first.index)
    truth = way.poses(seconds(frames[again.index] - 45 * MS)).apex
    errors = (spherical(again.xyz) - spherical(truth)) / np.sqrt(np.einsum("nii->ni", again.covariance))
    assert 0.7 < np.sqrt(np.mean(errors**2)) < 1.3
    nearest = pair_interpolated(found, frames, **near | {"offset_ns": 45 * MS}).index
    assert np.mean(nearest != first.index) > 0.3
    beyond = pair([v.time_ns for v in found], frames, **near, marked=len(frames) - 1, reach_ns=REACH_NS)[0]
    assert (beyond[:100] == pair([v.time_ns for v in found], frames, **near)[0][:100]).all()


def test_moved_vertices_lie_where_the_apex_was_at_the_frames_moment():
    offset = 30 * MS
    before, after, scored = [], [], []
    for seed in range(4):
        way = walk(seed)
        found = vertices(way, seed)
        frames = START_NS + offset + np.arange(0, 31 * 15) * 66_700_000
        pairs = pair_interpolated(found, frames, offset_ns=offset, max_gap_ns=34 * MS)
        index, gap = pair([v.time_ns for v in found], frames, offset_ns=offset, max_gap_ns=34 * MS)
        np.testing.assert_array_equal(pairs.index, index)
        np.testing.assert_array_equal(pairs.moved_ns, gap)
        truth = spherical(way.poses(seconds(frames[index] - offset)).apex)
        error = spherical(pairs.xyz) - truth
        before.append(spherical(np.array([v.xyz for v in found])) - truth)
        after.append(error)
        scored.append(error / np.sqrt(np.einsum("nii->ni", pairs.covariance)))
    rms = [np.sqrt(np.mean(np.concatenate(values) ** 2, axis=0)) for values in (before, after, scored)]
    assert (rms[1] < 0.75 * rms[0]).all()
    assert 0.8 < np.sqrt(np.mean(rms[2] ** 2)) < 1.2


def test_moving_does_not_depend_on_how_the_recording_is_cut():
    found = vertices(walk(7), 7)
    frames = START_NS + np.arange(0, 30 * 15) * 66_700_000
    whole = pair_interpolated(found, frames, max_gap_ns=34 * MS)
    for first in range(0, 300, 37):
        shard = [v for v in found if first <= v.sweep_index < first + 37]
        around = [
            v for v in found if first - MARGIN_SWEEPS <= v.sweep_index < first + 37 + MARGIN_SWEEPS and v not in shard
        ]
        part = pair_interpolated(shard, frames, context=around, max_gap_ns=34 * MS)
        rows = [found.index(v) for v in shard]
        np.testing.assert_array_equal(part.index, whole.index[rows])
        np.testing.assert_allclose(part.xyz, whole.xyz[rows], rtol=0, atol=1e-9)
        np.testing.assert_allclose(part.covariance, whole.covariance[rows], rtol=1e-6)


def test_a_vertex_too_far_from_any_frame_is_no_pair():
    found = vertices(walk(1), 1)[:5]
    near = found[2].time_ns
    pairs = pair_interpolated(found, [near + 9 * MS], max_gap_ns=20 * MS)
    assert pairs.index.tolist() == [-1, -1, 0, -1, -1]
    assert pairs.moved_ns.tolist() == [0, 0, 9 * MS, 0, 0]
    assert np.isfinite(pairs.xyz).all(axis=1).tolist() == [False, False, True, False, False]
    assert pair_interpolated(found, [], max_gap_ns=0).index.tolist() == [-1] * 5
    assert pair_interpolated([], [near], max_gap_ns=0).xyz.shape == (0, 3)


def test_the_track_is_not_followed_to_where_no_vertex_is_near():
    found = vertices(walk(1), 1)[:30]
    last, offset, minute = found[-1].time_ns, 30 * MS, 60_000 * MS
    for beyond, paired in ((REACH_NS, True), (REACH_NS + 1, False), (55_000 * MS, False)):
        pairs = pair_interpolated(found, [last + beyond + offset], offset_ns=offset, max_gap_ns=minute)
        assert (pairs.index[-1] == 0) == np.isfinite(pairs.xyz[-1]).all() == paired
        assert (pairs.moved_ns[-1] == beyond) == paired
        assert pairs.index[0] == -1, "its own window ends a second after it"
    # A frame far from a vertex, amid others that its window holds, is still a pair.
    amid = pair_interpolated(found, [found[0].time_ns + 1500 * MS], max_gap_ns=minute)
    assert amid.index[0] == 0
    # However the recording is cut.
    frames = [last + 800 * MS, last + 5_000 * MS]
    whole = pair_interpolated(found, frames, max_gap_ns=minute)
    shard = pair_interpolated(found[25:], frames, context=found[25 - MARGIN_SWEEPS : 25], max_gap_ns=minute)
    np.testing.assert_array_equal(shard.index, whole.index[25:])


def test_a_walk_is_a_track_and_still_poses_are_none():
    found = vertices(walk(1), 1)
    assert on_track(found).mean() > 0.99
    jumps = np.random.default_rng(2).uniform((2.0, -1.0, 0.0), (4.0, 1.0, 1.0), (len(found), 3))
    poses = [replace(vertex, xyz=tuple(place)) for vertex, place in zip(found, jumps.tolist(), strict=True)]
    assert not on_track(poses).any()


def test_a_track_is_one_however_the_recording_is_cut():
    found = vertices(walk(2), 2)
    shard, around = found[20:40], found[20 - MARGIN_SWEEPS : 20] + found[40 : 40 + MARGIN_SWEEPS]
    assert on_track(shard, around).tolist() == on_track(found)[20:40].tolist()


def test_vertices_without_neighbours_and_one_outlier():
    found = vertices(walk(3), 3)
    assert not on_track(found[::25]).any(), "more than two seconds apart"
    spoiled = [*found[:10], replace(found[10], xyz=(20.0, 0.0, 0.0)), *found[11:]]
    assert on_track(spoiled)[30:].all()
    assert on_track([]).tolist() == []
