"""People in a street, and no board."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from workers.simulation.walker import BodyPoses, Poses

_NO_BOARD_M = (0.0, 0.0)


class Street:
    """Some people who stand or go straight on; two of them side by side.

    Args:
        seed: of who goes where.
        ground_z: height of the ground in the level frame, metres; nothing stands on it here but people.
    """

    def __init__(self, seed: int, ground_z: float) -> None:
        random = np.random.default_rng([seed, 22])
        count = int(random.integers(2, 7))
        self._ground_z = ground_z
        self._start = random.uniform((4.0, -5.0), (25.0, 5.0), (count, 2))
        self._speed = random.normal(0.0, 0.8, (count, 2)) * (random.uniform(size=(count, 1)) < 0.7)
        self._start[1] = self._start[0] + random.uniform((-0.2, 0.45), (0.2, 0.7))
        self._speed[1] = self._speed[0]
        self._heading = random.uniform(0.0, 2.0 * np.pi, count)
        self._height = random.uniform(1.2, 1.95, count)
        self._torso_m = random.uniform(0.12, 0.24, count)

    def poses(self, time_s: NDArray[np.float64]) -> Poses:
        """Where they are at the moments ``time_s`` (T,), seconds; the first stands in the walker's place."""
        people = [self._person(number, time_s) for number in range(len(self._start))]
        first = people[0]
        edge = np.tile([0.0, np.sqrt(0.5), -np.sqrt(0.5)], (len(time_s), 1))
        return Poses(
            apex=np.column_stack([first.body, np.full(len(time_s), self._ground_z)]),
            edge_left=edge,
            edge_right=edge * (1.0, -1.0, 1.0),
            body=first.body,
            left=first.left,
            height=first.height,
            board_m=_NO_BOARD_M,
            torso_m=first.torso_m,
            others=tuple(people[1:]),
        )

    def _person(self, number: int, time_s: NDArray[np.float64]) -> BodyPoses:
        heading = self._heading[number]
        return BodyPoses(
            body=self._start[number] + time_s[:, None] * self._speed[number],
            left=np.tile([np.cos(heading), np.sin(heading)], (len(time_s), 1)),
            height=np.full(len(time_s), self._height[number]),
            torso_m=float(self._torso_m[number]),
        )
