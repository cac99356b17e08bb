import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workers.vertices.pairing import NO_FRAME_GAP_NS, pair

MS = 1_000_000
times = st.lists(st.integers(0, 2_000 * MS), max_size=30)


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


def test_stamps_of_today_keep_their_nanoseconds():
    moment = 1_780_000_000_123_456_789
    index, gap = pair([moment], [moment - 3, moment + 2], max_gap_ns=10)
    assert (index.tolist(), gap.tolist()) == ([1], [2])


def test_of_two_frames_equally_near_the_earlier_is_taken():
    index, gap = pair([100], [90, 110], max_gap_ns=10)
    assert (index.tolist(), gap.tolist()) == ([0], [-10])


def test_frames_in_any_order_keep_their_numbers():
    index, _ = pair([11, 29, 41], [40, 10, 30], max_gap_ns=5)
    assert index.tolist() == [1, 2, 0]


def test_the_offset_is_the_cameras_clock_minus_the_lidars():
    index, gap = pair([100], [100, 130], offset_ns=30, max_gap_ns=0)
    assert (index.tolist(), gap.tolist()) == ([1], [0])


def test_a_negative_limit_is_refused():
    with pytest.raises(ValueError, match="max_gap_ns"):
        pair(np.array([1]), np.array([1]), max_gap_ns=-1)
