"""Whether the board of a recording jumps from place to place: then sweeps tell nothing of each other."""

from __future__ import annotations

import math

import numpy as np

from workers.vertices.motion import jumps


def _walk(step_s: float, count: int, speed_m_s: float = 1.2) -> list[tuple[int, float, float]]:
    """Along a circle of 4 m."""
    turned = (speed_m_s * step_s * np.arange(count) / 4.0).tolist()
    return [(round(k * step_s * 1e9), 8.0 + 4.0 * math.cos(a), 4.0 * math.sin(a)) for k, a in enumerate(turned)]


def _poses(step_s: float, count: int) -> list[tuple[int, float, float]]:
    random = np.random.default_rng(4)
    return [(round(k * step_s * 1e9), *random.uniform((4.0, -3.0), (12.0, 3.0)).tolist()) for k in range(count)]


def test_a_walk_does_not_jump_and_poses_do():
    assert not jumps(_walk(0.3, 16))
    assert jumps(_poses(0.3, 16))


def test_a_body_that_is_taken_for_the_board_now_and_then_makes_no_jump_of_a_walk():
    places = _walk(0.3, 16)
    for k in (3, 7, 12):
        stamp, x, y = places[k]
        places[k] = stamp, x + 0.8, y
    assert not jumps(places)


def test_sweeps_of_a_long_walk_do_not_jump():
    """Of 300 s some hundred sweeps are looked at, three seconds apart."""
    assert not jumps(_walk(3.1, 96))
    near = _walk(0.3, 11)
    later = [(stamp + 16_000_000_000, x + 4.0, y) for stamp, x, y in _walk(0.3, 5)]
    assert not jumps([*near, *later])


def test_a_pose_after_a_pause_is_no_walk():
    """Two sweeps of each pose."""
    places = [(stamp + k * 100_000_000, x, y) for stamp, x, y in _poses(1.0, 12) for k in (0, 1)]
    assert jumps(places)
