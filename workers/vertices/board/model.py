"""The model of sensor, board and person: the detector's assumptions, or what it learned from near sweeps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.rays import WRONG
from workers.vertices.sensor_grid import SensorGrid
from workers.vertices.vertex import SizeFacts

Floats = NDArray[np.float64]
# Plywood panels are cut to 3.5 mm (EN 315). Bending, or a hand at the edge, moves an edge as much.
EDGE_M = 0.0035
# A beam leaves the sensor 9.5 mm wide (data sheets: OS1 9.5 mm, VLP-16 9.5 x 12.7 mm). Where within it a board's edge
# still answers depends on what stands behind that edge: the edge's position is uniform over the width.
BEAM_M = 0.0095 / math.sqrt(12.0)
MOST_ROLL_RAD = math.radians(20.0)
"""How far people roll a board from how it is held."""
# The grid of rolls reaches 2.8 standard deviations to either side.
_ROLL_SIGMA = MOST_ROLL_RAD / 2.8
_YAW_SIGMA = 0.6
# Radians from the rest angle: wider than any prior reaches, in steps that a person's spread of rolls covers several
# times.
ROLLS: Floats = np.radians(np.arange(-38.0, 38.25, 0.5))


@dataclass(frozen=True, slots=True, eq=False)
class BoardModel:
    """Sensor, board and person as assumed or learned; pairs are mean and standard deviation.

    Attributes:
        grid: the directions in which the sensor fires.
        sigma: metres, standard deviation of a distance.
        bias: metres, standard deviation of the error that neighbouring distances share: errors of rings, bends.
        ring_bias: metres, standard deviation of each ring's own constant error of distance.
        dropout_rate: share of the rays on the board that bring no return.
        blooming: radians by which the edges appear shifted outward, because a beam has a width.
        blooming_sigma: radians, standard deviation of blooming.
        inset: how far inside an edge a beam's centre can be and still return the background, radians; None: not
            learned.
        softness: radians, half width of the step from hits to misses at an edge.
        edges: metres, lengths of the board's edges.
        slack: metres, half width of the interval in which each of these lengths may lie.
        upper_corner: which corner the apex is. 0: the tip of a board with a corner up. Of a board with level edges
            1: the upper left corner, -1: the upper right one, as the sensor sees them.
        size: the board's measured size, or None. If it overrides the stated size, `edges` already holds it.
        roll: radians from the rest angle, counter-clockwise as the sensor sees it.
        yaw, tilt: slopes of the plane, depth per metre to the left and per metre up.
        swapped: share of sweeps in which the second edge is the one to the lower left.
        is_posed: whether the board jumps between sweeps, farther than anybody walks in that time.
        is_shown: whether the near sweeps show a board, on as many rings as meet it there.
        wrong: share of the returns at the board's edges that look as if their rays were on the edge's other side.
        wrong_below: share of the returns beside the board, below its widest ring, that lie in its plane: hands, body.
    """

    grid: SensorGrid
    sigma: float = 0.02
    edges: tuple[float, float] = (0.75, 0.75)
    slack: float = 0.35
    upper_corner: int = 0
    blooming: float = 0.0
    blooming_sigma: float = 0.0
    inset: float | None = None
    softness: float = math.radians(0.02)
    roll: tuple[float, float] = (0.0, _ROLL_SIGMA)
    yaw: tuple[float, float] = (0.0, _YAW_SIGMA)
    tilt: tuple[float, float] = (0.0, 0.10)
    swapped: float = 0.5
    dropout_rate: float = 0.004
    wrong: float = WRONG
    wrong_below: float = WRONG
    bias: float = 0.0
    ring_bias: float = 0.0
    is_posed: bool = False
    is_shown: bool = False
    size: SizeFacts | None = None

    def rest_angle(self, edges: tuple[float, float]) -> float:
        """Return the rest angle of a board with these edges (m), held as this one is; radians."""
        return rest_angle(edges, self.upper_corner)


def rest_angle(edges: tuple[float, float], upper_corner: int = 0) -> float:
    """Return the rest angle: radians by which the edge to the lower left falls if the board hangs from its apex.

    It is the mean of two angles: atan(first / second), at which the diagonal is upright, and 45 degrees, at which
    both edges fall alike. From an upper corner (`BoardModel.upper_corner`) one edge goes straight down: the left
    corner's first one, by 90 degrees, and the right corner's second one.
    """
    if upper_corner:
        return math.radians(45.0) * (1 + upper_corner)
    return 0.5 * (math.atan2(edges[0], edges[1]) + math.radians(45.0))


def any_roll(edges: tuple[float, float], upper_corner: int = 0) -> tuple[float, float]:
    """Return mean and standard deviation of the roll of boards in general, radians from the rest angle.

    People hold a board near one of two angles, whose mean is the rest angle, and roll it from there.
    """
    apart = 0.0 if upper_corner else 0.5 * abs(math.atan2(edges[0], edges[1]) - math.radians(45.0))
    return 0.0, math.hypot(_ROLL_SIGMA, apart)
