"""A person who carries the board through the field: where board and body are at any moment.

The board is a rectangle turned by 45 degrees, so that one vertex, the apex, is its highest point
(Lyu et al. 2019). The walker sways a little, raises and lowers the board, and ducks behind it, so that the
head stays below the apex, unless the head is meant to be in the way.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from apexcal.documents.simulation import BOARD_EDGES_M, Disturbances, SecondPerson, WalkName
from workers.simulation.walks import WALKS, Sines, walked

TORSO_RADIUS_M = 0.15
LEG_RADIUS_M = 0.075
LEG_APART_M = 0.10
HEAD_RADIUS_M = 0.105
_TALL_M = 1.74
_DUCK_M = 0.13  # the head's top stays this much below the apex
_LOWEST_APEX_M = 1.14  # the lowest corner just clears the ground
_HIGHEST_APEX_M = 2.50  # as high as arms reach
_REACH_PER_HEIGHT = 1.3


@dataclass(frozen=True, slots=True)
class BodyPoses:
    """A body at T moments, LiDAR frame, metres.

    Attributes:
        body: (T, 2) x y of the torso's axis.
        left: (T, 2) horizontal unit vector to the side that is left as seen from the LiDAR.
        height: (T,) of the person as they stand (ducking included), above the ground.
        torso_m: radius of the torso with what is worn.
    """

    body: NDArray[np.float64]
    left: NDArray[np.float64]
    height: NDArray[np.float64]
    torso_m: float = TORSO_RADIUS_M


@dataclass(frozen=True, slots=True)
class Poses:
    """Board and bodies at T moments, LiDAR frame, metres.

    Attributes:
        apex: (T, 3) the board's highest vertex.
        edge_left: (T, 3) unit vector from the apex along the edge that goes down to the LiDAR's left.
        edge_right: (T, 3) unit vector along the other edge.
        body: (T, 2) x y of the torso's axis.
        left: (T, 2) horizontal unit vector to the walker's side that is left as seen from the LiDAR.
        height: (T,) of the person as they stand (ducking included), above the ground.
        board_m: lengths of the edge to the left and the edge to the right.
        second: the person who goes along, where there is one.
        torso_m: radius of the walker's torso with what is worn.
        hands: (T, H, 4) centre and radius of hands and sleeves at the board's lower edges; None: out of sight.
        others: people who have nothing to do with the board.
    """

    apex: NDArray[np.float64]
    edge_left: NDArray[np.float64]
    edge_right: NDArray[np.float64]
    body: NDArray[np.float64]
    left: NDArray[np.float64]
    height: NDArray[np.float64]
    board_m: tuple[float, float] = BOARD_EDGES_M
    second: BodyPoses | None = None
    torso_m: float = TORSO_RADIUS_M
    hands: NDArray[np.float64] | None = None
    others: tuple[BodyPoses, ...] = ()


class Walk:
    """A walk over the field, as its plan says, until the time is over.

    Args:
        seed: of the way and of the board's motion.
        ground_z: height of the ground in the LiDAR frame, metres.
        plan: a name in ``walks.WALKS``.
        board_m: lengths of the board's edges, to the left and to the right of the apex as the LiDAR sees it.

    Attributes:
        rolled_deg: how far the board is rolled on average, counter-clockwise as the LiDAR sees it.
        tilted_deg: how far the board leans on average, the upper end away from the LiDAR, beyond the usual 2 degrees.
        turned_deg: how far board and person are turned from the LiDAR, counter-clockwise from above.
        body_behind_m: from the board to the axis of the torso.
        torso_m: radius of the torso with what is worn.
    """

    rolled_deg = 0.0
    tilted_deg = 0.0
    turned_deg = 0.0
    body_behind_m = 0.22
    torso_m = TORSO_RADIUS_M

    def __init__(
        self,
        seed: int,
        seconds: float,
        ground_z: float,
        *,
        plan: WalkName = "rows",
        disturbances: Disturbances | None = None,
        board_m: tuple[float, float] = BOARD_EDGES_M,
    ) -> None:
        random = np.random.default_rng([seed, 1])
        chosen = WALKS[plan]
        self._ground_z = ground_z
        self._board_m = board_m
        self._disturbances = disturbances or Disturbances()
        time_s, xy = walked(chosen, random, seconds + 2.0)
        self._path = CubicSpline(time_s, xy)
        self._raise = _Wander(random, chosen.raises)
        self._yaw = _Wander(random, chosen.yaws, np.pi / 180.0)
        self._roll = _Wander(random, chosen.rolls, np.pi / 180.0)
        self._tilt = _Wander(random, chosen.tilts, np.pi / 180.0)
        self._bob = _Wander(random, chosen.bobs)
        self._apart = _Wander(np.random.default_rng([seed, 6]), ((0.05, 0.13, 0.31), (0.5, 0.3, 0.2)))

    def poses(self, time_s: NDArray[np.float64]) -> Poses:
        """Board and bodies at the moments ``time_s`` (T,), seconds since the start."""
        xy = self._path(time_s)
        middle, share = self._carried()
        apex_height = middle + share * self._raise(time_s) + self._bob(time_s)
        apex = np.column_stack([xy, self._ground_z + apex_height])
        # The walker faces the vehicle, though not quite when at the side.
        yaw = 0.75 * np.arctan2(xy[:, 1], xy[:, 0]) + self._yaw(time_s) + np.deg2rad(self.turned_deg)
        zero = np.zeros_like(yaw)
        away = np.column_stack([np.cos(yaw), np.sin(yaw), zero])
        left = np.column_stack([-np.sin(yaw), np.cos(yaw), zero])
        # The lower end is towards the LiDAR, away from the legs.
        tilt = np.deg2rad(2.0 + self.tilted_deg) + self._tilt(time_s)
        up = np.column_stack([zero, zero, np.cos(tilt)]) + np.sin(tilt)[:, None] * away
        roll = np.deg2rad(45.0 + self.rolled_deg) + self._roll(time_s)
        cosine, sine = np.cos(roll)[:, None], np.sin(roll)[:, None]
        tall = self._disturbances.walker_height_m
        ducked = np.minimum(tall, apex_height - _DUCK_M)
        edges = (cosine * left - sine * up, -sine * left - cosine * up)
        return Poses(
            apex=apex,
            edge_left=edges[0],
            edge_right=edges[1],
            body=xy + self.body_behind_m * away[:, :2],
            left=left[:, :2],
            height=np.full_like(yaw, tall) if self._disturbances.head_above_m > 0.0 else ducked,
            board_m=self._board_m,
            second=self._second(time_s, xy, away[:, :2], left[:, :2], self._disturbances.second_person),
            torso_m=self.torso_m,
        )

    def _carried(self) -> tuple[float, float]:
        """The apex's mean height above the ground, and the share of the plan's way up and down that is used."""
        tall, above = self._disturbances.walker_height_m, self._disturbances.head_above_m
        lower = max(0.0, (sum(self._board_m) - sum(BOARD_EDGES_M)) * 0.72)  # a larger board needs more room below
        higher = _REACH_PER_HEIGHT * (tall - _TALL_M)
        whole = _HIGHEST_APEX_M - _LOWEST_APEX_M
        if above > 0.0:
            higher = min(higher, tall - above - _HIGHEST_APEX_M)
        return 1.82 + 0.5 * (lower + higher), max(1.0 + (higher - lower) / whole, 0.0)

    def _second(
        self,
        time_s: NDArray[np.float64],
        xy: NDArray[np.float64],
        away: NDArray[np.float64],
        left: NDArray[np.float64],
        where: SecondPerson,
    ) -> BodyPoses | None:
        """Beside: an arm's length to one side, the side for the whole walk; behind: within the board's width."""
        if where == "none":
            return None
        apart = self._apart(time_s)[:, None]
        body = xy + 0.9 * away + 0.5 * apart * left if where == "behind" else xy + (0.95 + 0.25 * apart) * left
        return BodyPoses(body, left, np.full(len(xy), 1.78))


class _Wander:
    """A smooth random function of time: a sum of sines with random phases and slightly random rates."""

    def __init__(self, random: np.random.Generator, sines: Sines, unit: float = 1.0) -> None:
        rates_hz, amplitudes = sines
        self._omega = 2.0 * np.pi * np.array(rates_hz) * random.uniform(0.9, 1.1, len(rates_hz))
        self._phase = random.uniform(0.0, 2.0 * np.pi, len(rates_hz))
        self._amplitude = np.asarray(amplitudes, np.float64) * unit

    def __call__(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sin(time_s[:, None] * self._omega + self._phase) @ self._amplitude
