"""Still poses by number, 0.1 s apart on paper: noticed and counted whatever else moves; walks are none."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.scenes.still import still_poses
from workers.readers.recording import Sweep
from workers.vertices.detectors import detect_range
from workers.vertices.pose_suggestion import boards_outside
from workers.vertices.region import Region
from workers.vertices.still_poses import find_poses
from workers.vertices.suggested_region import things_of
from workers.vertices.sweep_source import Listed

T0 = 1_000_000_000
ELEVATION = np.radians(np.arange(-15, 16, 2.0))


def sweep(number, posts, random=None):
    """A sweep of a yard of 12 m with posts 0.6 m wide (azimuth in degrees, distance in metres) and leaves at 30 m."""
    azimuth = -2 * np.pi * np.arange(900) / 900
    A, E = np.meshgrid(azimuth, ELEVATION, indexing="ij")
    ray = np.stack([np.cos(E) * np.cos(A), np.cos(E) * np.sin(A), np.sin(E)], -1)
    level = np.maximum(np.abs(np.cos(A)), np.abs(np.sin(A))) * np.cos(E)
    t = np.minimum(12.0 / level, np.where(ray[..., 2] < 0, 1.2 / np.maximum(1e-9, -ray[..., 2]), np.inf))
    if random is not None:  # a gap in the fence, through which few rays meet something
        gap = np.abs(np.degrees(A + np.pi) % 360 - 90) < 40
        t = np.where(gap & (ray[..., 2] > -0.02), np.where(random.random(A.shape) < 0.03, 30.0, np.nan), t)
    for degrees, metres in posts:
        off = np.abs((A - np.radians(degrees) + np.pi) % (2 * np.pi) - np.pi)
        post = (off < np.arctan(0.3 / metres)) & (np.abs(ray[..., 2] * metres) < 1.0)
        t = np.where(post, metres / np.cos(E), t)
    good = np.isfinite(t).ravel()
    xyz = (ray * t[..., None]).reshape(-1, 3)[good].astype(np.float32)
    ring = np.broadcast_to(np.arange(16, dtype=np.uint16), A.shape).ravel()[good]
    zero = np.zeros(len(xyz))
    return Sweep(T0 + number * 100_000_000, xyz, zero.astype(np.float32), ring, zero.astype(np.int64))


def test_a_few_points_far_away_are_no_larger_than_a_person():
    random = np.random.default_rng(2)
    far = [random.normal((31.0, 5.0 * k, 0.0), 0.3, (7, 3)) for k in range(-2, 3)]
    near = random.normal((2.0, 0.5, 0.0), (0.2, 0.2, 0.4), (500, 3))
    things = things_of(np.concatenate([*far, near]))
    assert len(things) > 3 and len(things[0].points) > 450


@pytest.mark.parametrize("count", [6, 12])
def test_poses_before_leaves_that_move(count):
    random = np.random.default_rng(5)
    places = [(float(50 * (k % 5) - 100), 2.0 + 0.3 * (k % 3)) for k in range(count)]
    source = Listed([sweep(k, [place], random) for k, place in enumerate(places)])
    poses = find_poses(source, stated=False)
    assert poses is not None and not poses.single and poses.count == count


def test_poses_of_which_some_are_a_step_apart():
    """After three poses that are 15 cm apart it jumps: between two jumps it gets farther than somebody sways."""
    places = [(60.0 * (k // 3 % 5) - 120 + 2.5 * (k % 3), 3.5) for k in range(36)]
    poses = find_poses(Listed([sweep(k, [place]) for k, place in enumerate(places)]), stated=False)
    assert poses is not None and poses.count == 36


def test_poses_behind_which_somebody_walks():
    """Who walks behind the stand is farther away, and as large."""
    random = np.random.default_rng(7)
    boards = [(float(random.uniform(-40, 40)), float(random.uniform(2.5, 5.0))) for _ in range(30)]
    posts = [[board, (float(random.uniform(-60, 60)), 7.0)] for board in boards]
    poses = find_poses(Listed([sweep(k, each) for k, each in enumerate(posts)]), stated=False)
    assert poses is not None


@pytest.mark.parametrize("step_deg", [0.4, 1.0, 2.5])
def test_a_walk_is_no_poses(step_deg):
    """At 3.5 m these are 0.25, 0.6 and 1.5 m/s."""
    source = Listed([sweep(k, [(-60.0 + step_deg * k, 3.5)]) for k in range(40)])
    assert find_poses(source, stated=False) is None


def test_a_vertex_of_a_pose_has_its_sweeps_own_stamp():
    """Points are measured 60 ms later than the stamp: at 10 Hz on paper the next pose's frame is nearer to that."""
    recording = still_poses("room", 2, 6)
    late = [replace(each, offset_ns=np.full(len(each.xyz), 60_000_000)) for each in recording.sweeps]
    low, high = recording.apex.min(axis=0) - 1.0, recording.apex.max(axis=0) + 1.0
    region = Region.from_document({"all": [{"box": {"min": low.tolist(), "max": high.tolist()}}]})
    detections = detect_range(Listed(late), region, "tolerant", {"max_top_points": 30}, indices=range(len(late)))
    assert detections.poses is not None and detections.vertices
    assert all(vertex.time_ns == late[vertex.sweep_index].stamp_ns for vertex in detections.vertices)


def test_a_region_that_leaves_boards_out_says_in_which_sweeps():
    recording = still_poses("room", 2, 6)
    poses = find_poses(recording.source, stated=True)
    assert poses is not None
    low, high = recording.apex[1] - (0.8, 0.8, 2.0), recording.apex[1] + (0.8, 0.8, 1.0)
    region = Region.from_document({"all": [{"box": {"min": low.tolist(), "max": high.tolist()}}]})
    out = [k for k in range(6) if not region.mask(recording.apex[k : k + 1])[0]]
    assert 1 not in out and len(out) == 5
    moved = [poses.background.compare(recording.source.sweep(number)).moved for number in range(6)]
    listed = boards_outside(recording.source, range(6), moved, poses.grid, region, lambda: None)
    assert set(listed) <= set(out) and len(listed) >= 3
