"""A walker who holds the board otherwise than the simulator's: rolled, leant, far from the body, with hands on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workers.simulation.walker import TORSO_RADIUS_M, Poses, Walk

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BoardHold:
    """How a person holds the board.

    Attributes:
        rolled_deg, tilted_deg, turned_deg, body_behind_m, torso_m: as those of :class:`Walk`.
        hand_m: radius of the hands and sleeves at the board's lower edges; 0: they are behind it.
    """

    rolled_deg: float = 0.0
    tilted_deg: float = 0.0
    turned_deg: float = 0.0
    body_behind_m: float = 0.22
    torso_m: float = TORSO_RADIUS_M
    hand_m: float = 0.0


class HeldWalk(Walk):
    """A walk with the board held as ``hold`` says."""

    def __init__(
        self, seed: int, seconds: float, ground_z: float, *, hold: BoardHold | None = None, **options: Any
    ) -> None:
        super().__init__(seed, seconds, ground_z, **options)
        hold = hold or BoardHold()
        self.rolled_deg, self.tilted_deg, self.turned_deg = hold.rolled_deg, hold.tilted_deg, hold.turned_deg
        self.body_behind_m, self.torso_m = hold.body_behind_m, hold.torso_m
        self._hand_m = hold.hand_m
        # Where along the lower edges each hand is, and how far before the board's plane its middle.
        gripping = np.random.default_rng([seed, 9])
        self._grips = np.column_stack([gripping.uniform(0.1, 0.8, 2), gripping.uniform(-0.03, 0.04, 2)])

    def poses(self, time_s: Floats) -> Poses:
        """Board, bodies and hands at the moments ``time_s`` (T,), seconds since the start."""
        poses = super().poses(time_s)
        return replace(poses, hands=self._hands(poses)) if self._hand_m > 0.0 else poses

    def _hands(self, poses: Poses) -> Floats:
        """Hands on both lower edges, each with a sleeve that goes down and out of the board from it."""
        apex, edge_left, edge_right = poses.apex, poses.edge_left, poses.edge_right
        long_left, long_right = poses.board_m
        before = np.cross(edge_left, edge_right)
        before *= -np.sign(np.sum(before * apex, axis=1, keepdims=True))  # towards the LiDAR
        balls: list[Floats] = []
        for (share, out), corner, along, length, outward in (
            (self._grips[0], apex + long_left * edge_left, edge_right, long_right, edge_left),
            (self._grips[1], apex + long_right * edge_right, edge_left, long_left, edge_right),
        ):
            hand = corner + share * length * along + out * before
            balls += [hand, hand + 1.5 * self._hand_m * (outward + along)]
        return np.stack([np.column_stack([ball, np.full(len(ball), self._hand_m)]) for ball in balls], axis=1)
