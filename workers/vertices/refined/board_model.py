"""What the detector takes as known, and what it says of one sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workers.vertices.refined.window import Window
from workers.vertices.sensor_grid import SensorGrid

Floats = NDArray[np.float64]
_LEAST_LIKELY, _TIMES_EXPECTED = -1.0, 1.5
# A board contradicts a ray that it has nothing to do with one time in two, a board's own rays hardly ever; half way.
_CONTRADICTED = 0.25
# Plywood panels are cut to 3.5 mm (EN 315), and what bends a board, or a hand at its edge, moves an edge as much.
EDGE_M = 0.0035
# A board and a leg, or a head, can lie in one plane on two or three rings; hardly on more.
TELLING_RINGS = 4
# Boards are held rolled by up to 20 degrees, and the roll's grid reaches 2.8 deviations to either side.
_ROLL_SIGMA = math.radians(20.0) / 2.8


@dataclass(frozen=True, slots=True, eq=False)
class BoardModel:
    """Sensor, board and person; pairs are mean and standard deviation.

    Attributes:
        grid: where the sensor found_in.
        sigma: metres, standard deviation of a distance.
        edges: metres, lengths of the board's edges.
        slack: metres, half width of what is not known of these lengths.
        growth: radians by which the edges seem to lie farther out, because a beam has a width; growth_sigma: its
            standard deviation.
        soft: radians, half width of the step from hits to misses at an edge.
        roll: radians from how the board hangs (`hang`), counter-clockwise as the sensor sees it.
        yaw, tilt: slopes of the plane, depth per metre to the left and per metre up.
        swapped: share of sweeps in which the second edge is the one to the lower left.
        lost: share of the rays on the board that bring no return.
        bias: metres, standard deviation of what the rings' distances are off by, each for itself.
        poses: whether the sweeps show poses, between which nobody walks within the time that their stamps leave.
        wrong: share of the returns at the board's edges that answer as if their rays were on the other side.
    """

    grid: SensorGrid
    sigma: float = 0.02
    edges: tuple[float, float] = (0.75, 0.75)
    slack: float = 0.35
    growth: float = 0.0
    growth_sigma: float = 0.0
    soft: float = math.radians(0.02)
    roll: tuple[float, float] = (0.0, _ROLL_SIGMA)
    yaw: tuple[float, float] = (0.0, 0.6)
    tilt: tuple[float, float] = (0.0, 0.10)
    swapped: float = 0.5
    lost: float = 0.004
    wrong: float = 0.002
    bias: float = 0.0
    poses: bool = False


def hang(edges: tuple[float, float]) -> float:
    """Radians by which the edge to the lower left falls where a board hangs from its tip.

    Half way between an upright diagonal, at atan(first / second), and edges that fall alike, at 45 degrees.
    """
    return 0.5 * (math.atan2(edges[0], edges[1]) + math.radians(45.0))


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane w . X = 1 in a window's frame, and the rays that tell where the board in it ends.

    Attributes:
        centre: radians, azimuth of the frame's x'.
        w: (3,) and spread: (3, 3) its covariance.
        score: log likelihood of the points in it, against clutter.
        left, up: (N,) metres, where each ray meets the plane, from the foot of the sensor's perpendicular.
        reach: (N,) metres, distance to there.
        ratio: (N,) likelihood of what the ray met with the board over that without.
        rings: how many rings meet the board; top_ring: the highest of them.
        points: how many points lie on it.
        returned: (N,) whether the ray brought a return.
        telling: whether so many rings meet it that a board and a leg, or a head, do not lie in it by chance.
    """

    centre: float
    w: Floats
    spread: Floats
    score: float
    left: Floats
    up: Floats
    reach: Floats
    ratio: Floats
    rings: int
    top_ring: int
    points: int
    returned: NDArray[np.bool_]
    telling: bool


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A plane, the window in which it was found, and (R, 2) the board's first and last column there, -1 for none."""

    plane: Plane
    window: Window
    ends: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """The apex that a plane's rays tell.

    Attributes:
        xyz: (3,) metres, LiDAR frame.
        covariance: (3, 3) of azimuth, elevation (rad) and range (m).
        sigma: radians, azimuth and elevation together, from the sweep's own rays: without what all sweeps share.
        roll, roll_sigma: radians, from how the board hangs.
        against: how many returns contradict the board: hits outside of it, and returns off its plane inside of it.
        upper: how many of them lie above the board's side corners, and how many returns do.
        best: log likelihood of the rays for the likeliest board, 0 where every ray is as expected.
        expected: that log likelihood where the board is there and the sensor does what was learned of it.
        evidence: log of the rays' likelihood, averaged over the prior.
        swapped: log odds that the second edge is the one to the lower left.
    """

    plane: Plane
    xyz: Floats
    covariance: Floats
    sigma: float
    roll: float
    roll_sigma: float
    against: int
    upper: tuple[int, int]
    best: float
    expected: float
    evidence: float
    swapped: float

    @property
    def explained(self) -> bool:
        """Whether the returns agree with a board rather than with none.

        On few rings every ray counts, and noise alone decides how likely they are. On more of them a real board is
        never as likely as its noise lets expect, for what bends or holds it; there, contradictions are counted.
        """
        if not self.plane.telling and self.best < _LEAST_LIKELY + _TIMES_EXPECTED * self.expected:
            return False
        return self.against < _CONTRADICTED * (self.plane.points + self.against)

    @property
    def support(self) -> float:
        """Log likelihood of points and rays together, to compare planes of one sweep."""
        return self.evidence + self.plane.score

    @property
    def sigma_azimuth(self) -> float:
        """Radians."""
        return math.sqrt(self.covariance[0, 0])

    @property
    def sigma_elevation(self) -> float:
        """Radians."""
        return math.sqrt(self.covariance[1, 1])
