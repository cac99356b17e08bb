"""A person who carries the board through the field: where board and body are at any moment.

The board is a rectangle turned by 45 degrees, so that one vertex, the apex, is its highest point
(Lyu et al. 2019). The walker sways a little, raises and lowers the board, and ducks behind it, so that the
head stays below the apex.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

BOARD_EDGES_M = (0.6096, 0.9144)  # 2 x 3 feet
TORSO_RADIUS_M = 0.15
LEG_RADIUS_M = 0.075
LEG_APART_M = 0.10
HEAD_RADIUS_M = 0.105
BODY_BEHIND_BOARD_M = 0.22  # axis of the torso behind the board: its front is 7 cm behind
_TALL_M = 1.74
_DUCK_M = 0.13  # the head's top stays this much below the apex
_TICK_S = 0.05


@dataclass(frozen=True, slots=True)
class Poses:
    """Board and body at T moments, LiDAR frame, metres.

    Attributes:
        apex: (T, 3) the board's highest vertex.
        edge_left: (T, 3) unit vector from the apex along the edge that goes down to the LiDAR's left.
        edge_right: (T, 3) unit vector along the other edge.
        body: (T, 2) x y of the torso's axis.
        left: (T, 2) horizontal unit vector to the walker's side that is left as seen from the LiDAR.
        height: (T,) of the person as they stand (ducking included), above the ground.
    """

    apex: NDArray[np.float64]
    edge_left: NDArray[np.float64]
    edge_right: NDArray[np.float64]
    body: NDArray[np.float64]
    left: NDArray[np.float64]
    height: NDArray[np.float64]


class Walk:
    """A walk over a field of 3.2-30 m x 10 m, back and forth until the time is over.

    Slow where near, because there the apex moves fast in the image while the nearest frame is up to half a
    frame away, and because far away few rings meet the board. Far to both sides, because only there do the terms of
    a lens tell yaw from c_x; up and down as far as arms and ground allow, which tells pitch from c_y.
    """

    def __init__(self, seed: int, seconds: float, ground_z: float) -> None:
        random = np.random.default_rng([seed, 1])
        self._ground_z = ground_z
        time_s, xy = _walked(random, seconds + 2.0)
        self._path = CubicSpline(time_s, xy)
        self._raise = _Wander(random, (0.1, 0.23), (0.64, 0.04))
        self._yaw = _Wander(random, (0.11, 0.37, 0.9), np.deg2rad((5.0, 3.0, 1.0)))
        self._roll = _Wander(random, (0.17, 0.45, 1.1), np.deg2rad((2.5, 1.5, 0.6)))
        self._tilt = _Wander(random, (0.14, 0.5), np.deg2rad((1.5, 0.8)))
        self._bob = _Wander(random, (1.7,), (0.008,))

    def poses(self, time_s: NDArray[np.float64]) -> Poses:
        """Board and body at the moments ``time_s`` (T,), seconds since the start."""
        xy = self._path(time_s)
        apex_height = 1.82 + self._raise(time_s) + self._bob(time_s)
        apex = np.column_stack([xy, self._ground_z + apex_height])
        # The walker faces the vehicle, though not quite when at the side.
        yaw = 0.75 * np.arctan2(xy[:, 1], xy[:, 0]) + self._yaw(time_s)
        zero = np.zeros_like(yaw)
        away = np.column_stack([np.cos(yaw), np.sin(yaw), zero])
        left = np.column_stack([-np.sin(yaw), np.cos(yaw), zero])
        tilt = np.deg2rad(2.0) + self._tilt(time_s)  # the lower end towards the LiDAR, away from the legs
        up = np.column_stack([zero, zero, np.cos(tilt)]) + np.sin(tilt)[:, None] * away
        roll = np.deg2rad(45.0) + self._roll(time_s)
        cosine, sine = np.cos(roll)[:, None], np.sin(roll)[:, None]
        return Poses(
            apex=apex,
            edge_left=cosine * left - sine * up,
            edge_right=-sine * left - cosine * up,
            body=xy + BODY_BEHIND_BOARD_M * away[:, :2],
            left=left[:, :2],
            height=np.minimum(_TALL_M, apex_height - _DUCK_M),
        )


class _Wander:
    """A smooth random function of time: a sum of sines with random phases and slightly random rates."""

    def __init__(
        self,
        random: np.random.Generator,
        rates_hz: tuple[float, ...],
        amplitudes: tuple[float, ...] | NDArray[np.float64],
    ) -> None:
        self._omega = 2.0 * np.pi * np.array(rates_hz) * random.uniform(0.9, 1.1, len(rates_hz))
        self._phase = random.uniform(0.0, 2.0 * np.pi, len(rates_hz))
        self._amplitude = np.asarray(amplitudes, np.float64)

    def __call__(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sin(time_s[:, None] * self._omega + self._phase) @ self._amplitude


def _waypoints(random: np.random.Generator) -> NDArray[np.float64]:
    """A serpentine over the field: rows across it, each as wide as the field or the sensors' view allows."""
    side = float(random.choice([-1.0, 1.0]))
    points: list[tuple[float, float]] = []
    for x in (3.2, 3.9, 4.7, 5.6, 7.5, 11.0, 29.5):
        half_width = min(5.0, x * np.tan(np.deg2rad(50.0)))
        points += [(x, side * half_width), (x, -side * half_width)]
        side = -side
    return np.array(points) + random.uniform(-0.15, 0.15, (len(points), 2))


def _walked(random: np.random.Generator, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Even ticks (T,) in seconds and the walker's smooth path (T, 2) over at least ``seconds``."""
    corners = _waypoints(random)
    steps: list[NDArray[np.float64]] = []
    for start, end in pairwise(corners):
        count = max(2, int(np.ceil(np.linalg.norm(end - start) / 0.02)))
        steps.append(start + (end - start) * np.linspace(0.0, 1.0, count, endpoint=False)[:, None])
    line = np.concatenate(steps)
    line = np.concatenate([line, line[::-1]])  # there and back, so that a long walk repeats without a jump
    pace = np.clip(0.016 * np.sum(line**2, axis=1), 0.4, 2.0)  # metres per second
    length = np.linalg.norm(np.diff(line, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(length / pace[:-1])])
    ticks = np.arange(0.0, seconds + 1.0, _TICK_S)
    # Starts a second into the path: smoothing bends its ends.
    turn = np.mod(ticks + 1.0, at[-1])
    xy = np.column_stack([np.interp(turn, at, line[:, axis]) for axis in range(2)])
    smooth: NDArray[np.float64] = gaussian_filter1d(xy, 0.4 / _TICK_S, axis=0, mode="nearest")
    return ticks - 0.5, smooth
