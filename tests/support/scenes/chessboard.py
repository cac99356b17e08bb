"""Simulated still poses of a large chessboard with level edges on a stand, in a garage: turned, leaning, half black.

Black squares that a beam meets at a slant bring late returns or none, while walls behind the board always answer.
Frame: x forward, y left, z up, metres; the sensor is the origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tests.support.scenes.still import BOARD, Board, Sensor, Things
from workers.readers.recording import Sweep
from workers.vertices.sweep_source import Listed

Floats = NDArray[np.float64]
EDGES_M: Final = (0.95, 1.1)
_SQUARE_M: Final = 0.15
_SQUARES: Final = (6, 7)
_RIM_M: Final = 0.025  # white
_GROUND_M: Final = -1.2
_TURNED_RAD: Final = math.radians(50.0)
_LEANT_RAD: Final = math.radians(20.0)


@dataclass(frozen=True, slots=True)
class LevelPoses:
    """Sweeps, one a pose, and where the upper left and the upper right corner truly were (S, 3)."""

    source: Listed
    left: Floats
    right: Floats


def chessboard_poses(seed: int, poses: int, *, lost_share: float = 0.9, late_m: float = 0.12) -> LevelPoses:
    """A recording of so many poses, 2.2 to 5.5 m away, turned by up to 50 degrees and leaning by up to 20.

    Args:
        lost_share: share of the returns that a black square met at 60 degrees from its normal does not give.
        late_m: how much longer a range is there at most.
    """
    random = np.random.default_rng([seed, 7])
    walls = Things()
    walls.boxes.append((random.uniform(8.0, 12.0), 0.0, 1.0, 0.5, 12.0, 3.0, random.uniform(-0.2, 0.2)))
    for side in (-1.0, 1.0):
        walls.boxes.append((0.0, side * random.uniform(5.5, 8.0), 1.0, 15.0, 0.5, 3.0, 0.0))
    sensor = replace(Sensor.drawn("vlp16", random), lost=0.01)
    sweeps: list[Sweep] = []
    corners: list[tuple[Floats, Floats]] = []
    for number in range(poses):
        board, foot = _board(random)
        things = Things(list(walls.boxes), [(*foot[:2].tolist(), 0.03, _GROUND_M, float(foot[2]))])
        sweep, label = sensor.sweep(things, board, _GROUND_M, random, number, 2.0)
        reach = np.linalg.norm(sweep.xyz, axis=1)
        ray = sweep.xyz / reach[:, None]
        normal = np.cross(*board.along)
        p, q = board.along @ (ray * (board.apex @ normal / (ray @ normal))[:, None] - board.apex).T
        squares = [np.floor((at - _RIM_M) / _SQUARE_M) for at in (p, q)]
        on_squares = np.all([(n >= 0) & (n < m) for n, m in zip(squares, _SQUARES, strict=True)], axis=0)
        is_black = (label == BOARD) & on_squares & (sum(squares) % 2 == 0)
        slanted = np.clip(2.0 * (1.0 - np.abs(ray @ normal)), 0.0, 1.0) * is_black
        late = late_m * slanted * random.uniform(size=len(reach)) ** 3
        kept = random.uniform(size=len(reach)) >= lost_share * slanted
        xyz = (sweep.xyz + late[:, None] * ray)[kept].astype(np.float32)
        rest = {name: getattr(sweep, name)[kept] for name in ("intensity", "ring", "offset_ns")}
        sweeps.append(replace(sweep, xyz=xyz, **rest))
        corners.append((board.apex, board.apex + EDGES_M[1] * board.along[1]))
    left, right = np.array(corners).transpose(1, 0, 2)
    return LevelPoses(Listed(sweeps), left, right)


def _board(random: np.random.Generator) -> tuple[Board, Floats]:
    """Return a board somewhere, and the upper end of its stand (3,)."""
    azimuth, lean = random.uniform(-0.5, 0.5), random.uniform(-_LEANT_RAD, _LEANT_RAD)
    yaw, roll = azimuth + random.uniform(-_TURNED_RAD, _TURNED_RAD), math.radians(random.normal(0.0, 1.5))
    towards = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    level = np.array([-towards[1], towards[0], 0.0])
    up = np.array([0.0, 0.0, math.cos(lean)]) + math.sin(lean) * towards
    down = math.sin(roll) * level - math.cos(roll) * up
    right = -math.cos(roll) * level - math.sin(roll) * up
    away = random.uniform(2.2, 5.5)
    middle = np.array([away * math.cos(azimuth), away * math.sin(azimuth), random.uniform(-0.2, 0.2)])
    corner = middle - 0.5 * (EDGES_M[0] * down + EDGES_M[1] * right)
    return Board(corner, np.array([down, right]), EDGES_M), middle + 0.06 * towards
