"""The scene around the walker: the ground, a wall at the back, poles at the sides.

LiDAR frame of the simulated rig: x forward, y left, z up, metres; the sensor is the origin.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray


def _poles() -> NDArray[np.float64]:
    rows = [(x, side * 6.6, 0.09, 3.2) for x in (9.0, 17.0, 25.0, 33.0) for side in (-1.0, 1.0)]
    return np.array(rows, np.float64)


@dataclass(frozen=True, slots=True)
class Scene:
    """The static surroundings.

    Attributes:
        ground_z: height of the ground plane under the LiDAR, metres.
        wall_x: distance of the back wall.
        wall_half_width, wall_height: metres; the height is above the ground.
        poles: (P, 4) x, y, radius, height above the ground, metres.
        boxes: (B, 7) cars, walls, doors and signs: x, y, heading (radians), half length, half width, lowest and
            highest point above the ground, metres.
    """

    ground_z: float = -1.85
    wall_x: float = 40.0
    wall_half_width: float = 26.0
    wall_height: float = 3.0
    poles: NDArray[np.float64] = field(default_factory=_poles)
    boxes: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 7)))


def scene_with(poles: int, seed: int) -> Scene:
    """The scene with that many more poles, which stand where the walker walks (and walks through them)."""
    scene = Scene()
    if poles == 0:
        return scene
    random = np.random.default_rng([seed, 8])
    low, high = (5.0, -3.0, 0.04, 1.6), (20.0, 3.0, 0.08, 2.8)
    return replace(scene, poles=np.concatenate([scene.poles, random.uniform(low, high, (poles, 4))]))


# What a rig's owner would choose for this scene: in front, off the ground, between the poles, before the wall.
WALKER_REGION = {
    "all": [
        {"quantity": "x", "op": ">", "value": 2.0},
        {"quantity": "x", "op": "<", "value": 33.0},
        {"quantity": "y", "op": ">", "value": -6.2},
        {"quantity": "y", "op": "<", "value": 6.2},
        {"quantity": "z", "op": ">", "value": -1.7},
    ]
}
