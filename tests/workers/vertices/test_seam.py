"""Sweeps whose seam lies in the region, cut elsewhere."""

from itertools import pairwise

import numpy as np
import pytest

from tests.support.scenes.flawed_lidar import Mount
from tests.workers.vertices.refined_walks import REGION, SIZE, errors, walk
from tests.workers.vertices.sweeps import EVERYTHING
from workers.vertices.cut_angle import Pieces, find_cut
from workers.vertices.detectors import detect_range
from workers.vertices.sweep_source import Listed

AHEAD = Mount(seam_deg=0.0)


def test_sweeps_that_begin_beside_the_region_are_left_as_they_are():
    assert find_cut(walk(3, 1.0).source, REGION) is None
    assert find_cut(walk(3, 1.0, mount=Mount(seam_deg=180.0)).source, REGION) is None
    assert find_cut(Listed([]), REGION) is None


@pytest.mark.parametrize("seam_deg", [0.0, 25.0, -40.0])
def test_a_seam_in_the_region_is_found_with_how_the_sensor_turns(seam_deg):
    recorded = walk(3, 1.0, mount=Mount(seam_deg=seam_deg))
    cut = find_cut(recorded.source, REGION)
    assert cut is not None and cut.direction == -1
    assert cut.turn_ns == pytest.approx(1e8, rel=1e-3)
    assert abs(np.degrees(cut.azimuth)) > 80.0


def test_pieces_hold_every_point_once_in_the_order_of_time():
    recorded = walk(3, 1.0, mount=AHEAD)
    cut = find_cut(recorded.source, REGION)
    pieces = Pieces(recorded.source, cut)
    assert len(pieces) == 11
    cut_up = [pieces.sweep(k) for k in range(11)]
    assert sum(len(piece.xyz) for piece in cut_up) == sum(len(sweep.xyz) for sweep in recorded.sweeps)
    for piece in cut_up:
        # A sector of 110 degrees takes 31 ms; across the seam it took 100.
        assert np.ptp(piece.offset_ns) < 32e6
    times = [piece.stamp_ns + piece.offset_ns for piece in cut_up]
    assert all(before.max() < after.min() for before, after in pairwise(times))


def test_the_larger_part_is_kept_where_a_sweep_is_missing():
    recorded = walk(3, 1.0, mount=AHEAD)
    cut = find_cut(recorded.source, REGION)
    gap = Listed([*recorded.sweeps[:4], *recorded.sweeps[6:]])
    whole, broken = Pieces(recorded.source, cut), Pieces(gap, cut)
    late = recorded.sweeps[3].offset_ns > 50_000_000
    early = recorded.sweeps[6].offset_ns < 50_000_000
    assert len(broken.sweep(4).xyz) == max(np.count_nonzero(late), np.count_nonzero(early))
    assert len(whole.sweep(4).xyz) > len(broken.sweep(4).xyz)


def test_a_sweep_that_was_recorded_twice_is_not_joined_to_itself():
    recorded = walk(3, 1.0, mount=AHEAD)
    cut = find_cut(recorded.source, REGION)
    pieces = Pieces(Listed([*recorded.sweeps[:5], *recorded.sweeps[4:]]), cut)
    assert all(np.ptp(pieces.sweep(k).offset_ns) < 32e6 for k in range(len(pieces)))


def test_a_board_across_the_seam_gives_as_many_vertices_as_elsewhere():
    """Before, a third of them were lost or timed a turn apart."""
    plain, ahead = walk(25, 3.0), walk(25, 3.0, mount=AHEAD)
    usual, found = (detect_range(r.source, REGION, "refined", SIZE, indices=r.all) for r in (plain, ahead))
    across = np.abs(np.degrees(np.arctan2(ahead.apex[:, 1], ahead.apex[:, 0]))) < 4.0
    assert np.count_nonzero(across) > 5
    assert len(found.vertices) > 0.95 * len(usual.vertices)
    wrong, _ = errors(ahead, found.vertices)
    assert np.sqrt(np.mean(np.sum(wrong[:, :2] ** 2, axis=1))) < 0.09
    off = [abs(vertex.time_ns - ahead.moment_ns[vertex.sweep_index]) for vertex in found.vertices]
    at_seam = np.abs(np.degrees(np.arctan2(ahead.apex[:, 1], ahead.apex[:, 0]))) < 0.5
    # On the seam itself the sensor looks at the apex at both ends of a sweep.
    assert all(ns < 300_000 or at_seam[vertex.sweep_index] for ns, vertex in zip(off, found.vertices, strict=True))
    part_of = range(12, 15)
    numbers = sorted([*(vertex.sweep_index for vertex in found.vertices), *found.refused])
    assert numbers == list(range(found.frames))
    part = detect_range(ahead.source, REGION, "refined", SIZE, indices=part_of)
    assert part.vertices == [vertex for vertex in found.vertices if vertex.sweep_index in part_of]


def test_a_region_that_is_everywhere_is_cut_where_nothing_returns():
    recorded = walk(3, 1.0, mount=AHEAD)
    cut = find_cut(recorded.source, EVERYTHING)
    assert cut is not None and abs(np.degrees(cut.azimuth)) > 80.0
