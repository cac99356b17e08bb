"""Velocities of pairs of several corners of one board."""

import numpy as np
import pytest

from apexcal.geometry.motion import velocities_of


def test_each_corner_is_followed_by_itself():
    times = np.arange(0.0, 4.0, 0.1)
    way = np.column_stack([5.0 + times, np.sin(times), 0.5 + 0.0 * times])
    offsets = {"top": (0.0, 0.0, 0.0), "left": (0.0, 0.5, -0.5), "bottom": (0.0, 0.0, -1.0)}
    rows = [
        (time, name, place + np.array(offset))
        for time, place in zip(times, way, strict=True)
        for name, offset in offsets.items()
    ]
    order = np.random.default_rng(1).permutation(len(rows))
    stamps = np.array([rows[k][0] for k in order]) * 1e9
    points = np.array([rows[k][2] for k in order])
    names = [rows[k][1] for k in order]
    found = velocities_of(points, stamps.astype(np.int64), names)
    true = np.column_stack([np.ones(len(order)), np.cos(stamps * 1e-9), np.zeros(len(order))])
    assert np.abs(found - true).max() < 0.15
    alone = velocities_of(way, (times * 1e9).astype(np.int64))
    tips = [k for k, name in enumerate(names) if name == "top"]
    np.testing.assert_allclose(found[tips][np.argsort(stamps[tips])], alone, atol=1e-9)
    assert velocities_of(points, stamps.astype(np.int64)) is None, "without their names, corners look like jumps"


def test_still_poses_with_made_up_times_have_no_velocities():
    random = np.random.default_rng(3)
    poses = np.repeat(random.uniform((3.0, -2.0, 0.5), (7.0, 2.0, 1.0), (8, 3)), 2, axis=0)
    points = poses + random.normal(0.0, 0.005, poses.shape)
    assert velocities_of(points, np.arange(16) * 100_000_000) is None
    walk = points[0] + np.outer(np.arange(24), (0.12, 0.05, 0.0))
    walk[9] += 0.5  # a false board is no reason to doubt all others
    assert velocities_of(walk, np.arange(24) * 100_000_000) is not None


def test_corners_that_are_seen_once_have_no_velocity():
    stamps = np.arange(6) * 100_000_000
    points = np.column_stack([np.arange(6) * 0.1, np.zeros(6), np.zeros(6)])
    found = velocities_of(points, stamps, ["top"] * 5 + ["left"])
    assert found[:5, 0] == pytest.approx(1.0)
    assert found[5].tolist() == [0.0, 0.0, 0.0]
    assert velocities_of(points[:2], stamps[:2], ["top", "left"]) is None
