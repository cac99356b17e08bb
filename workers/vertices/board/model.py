"""What the detector assumes as known, and what it finds in one sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.rays import WRONG
from workers.vertices.range_image import RangeImage
from workers.vertices.sensor_grid import SensorGrid
from workers.vertices.vertex import SizeFacts

Floats = NDArray[np.float64]
_LEAST_LIKELY, _TIMES_EXPECTED = -1.0, 1.5
# A return contradicts a board that has nothing to do with it one time in two.
_BY_CHANCE = 0.5
# On few rings a board has too few returns to tell its own share of contradictions: the limit lies half way.
_CONTRADICTED = 0.25
# Plywood panels are cut to 3.5 mm (EN 315). Bending, or a hand at the edge, moves an edge as much.
EDGE_M = 0.0035
# A beam leaves the sensor 9.5 mm wide (data sheets: OS1 9.5 mm, VLP-16 9.5 x 12.7 mm). Where within it a board's edge
# still answers depends on what stands behind that edge: the edge's place is even over the width.
BEAM_M = 0.0095 / math.sqrt(12.0)
# By chance a board and a leg, or a head, can lie in one plane on two or three rings, but hardly on more.
TELLING_RINGS = 4
# Breadth of the hips of a standing man, 95th percentile (DIN 33402-2); the trunk is no broader.
TRUNK_M = 0.4
# People roll boards by up to 20 degrees; the grid of rolls reaches 2.8 standard deviations to either side.
_ROLL_SIGMA = math.radians(20.0) / 2.8
# Doors and cars have upright edges, and up is known to 4 degrees. A board of 1 : 1.6 hangs at 32 degrees and is
# rolled by up to 20, so its edges are 12 degrees from upright. This is half way.
_UPRIGHT = math.radians(8.0)
_YAW_SIGMA = 0.6
# People show boards turned by up to 60 degrees and lean them by 35; planes are 5 degrees off at most.
_MOST_YAW, _MOST_TILT = math.tan(math.radians(65.0)), math.tan(math.radians(40.0))
MOST_ON_BOARD = 0.5
_TRUSTED_RAD = math.radians(0.3)
_HARDLY = 0.025  # two standard deviations on one side
# Radians from `hang`: wider than any prior reaches, in steps that a person's spread of rolls covers several times.
ROLLS: Floats = np.radians(np.arange(-38.0, 38.25, 0.5))


@dataclass(frozen=True, slots=True, eq=False)
class BoardModel:
    """Sensor, board and person; pairs are mean and standard deviation.

    Attributes:
        grid: the directions in which the sensor fires.
        sigma: metres, standard deviation of a distance.
        edges: metres, lengths of the board's edges.
        slack: metres, half width of the range in which each of these lengths may lie.
        upper_corner: which corner the vertex is. 0: the tip, of a board with a corner up. Of one with level edges 1:
            the upper left corner, -1: the upper right one, as the sensor sees them.
        growth: radians by which the edges seem to lie farther out, because a beam has a width.
        growth_sigma: radians, standard deviation of growth.
        inset: radians by which the middle of a beam may lie inside of an edge while it still meets what is behind it;
            None if that was not learned.
        soft: radians, half width of the step from hits to misses at an edge.
        roll: radians from how the board hangs (`hang`), counter-clockwise as the sensor sees it.
        yaw, tilt: slopes of the plane, depth per metre to the left and per metre up.
        swapped: share of sweeps in which the second edge is the one to the lower left.
        lost: share of the rays on the board that bring no return.
        bias: metres, standard deviation of what neighbouring distances have in common: errors of rings, bends.
        ring_bias: metres, standard deviation of each ring's own constant error of distance.
        poses: whether the board jumps between sweeps: nobody walks so far in the time between their stamps.
        shown: whether the near sweeps show a board, on as many rings as meet it there.
        size: of the board as boards show it; if it replaces the stated one, the edges are these. None: not told.
        wrong: share of the returns at the board's edges that look as if their rays were on the edge's other side.
        wrong_below: share of the returns beside the board, below its widest ring, that lie in its plane: hands, body.
    """

    grid: SensorGrid
    sigma: float = 0.02
    edges: tuple[float, float] = (0.75, 0.75)
    slack: float = 0.35
    upper_corner: int = 0
    growth: float = 0.0
    growth_sigma: float = 0.0
    inset: float | None = None
    soft: float = math.radians(0.02)
    roll: tuple[float, float] = (0.0, _ROLL_SIGMA)
    yaw: tuple[float, float] = (0.0, _YAW_SIGMA)
    tilt: tuple[float, float] = (0.0, 0.10)
    swapped: float = 0.5
    lost: float = 0.004
    wrong: float = WRONG
    wrong_below: float = WRONG
    bias: float = 0.0
    ring_bias: float = 0.0
    poses: bool = False
    shown: bool = False
    size: SizeFacts | None = None

    def rest_angle(self, edges: tuple[float, float]) -> float:
        """Radians, see `hang`."""
        return hang(edges, self.upper_corner)


def hang(edges: tuple[float, float], upper_corner: int = 0) -> float:
    """Radians by which the edge to the lower left falls, if the board hangs from its tip. Roll is counted from there.

    It is the mean of two angles: atan(first / second), at which the diagonal is upright, and 45 degrees, at which
    both edges fall alike. From an upper corner (`BoardModel.upper_corner`) one edge goes straight down: the left
    corner's first one, by 90 degrees, and the right corner's second one.
    """
    if upper_corner:
        return math.radians(45.0) * (1 + upper_corner)
    return 0.5 * (math.atan2(edges[0], edges[1]) + math.radians(45.0))


def any_roll(edges: tuple[float, float], upper_corner: int = 0) -> tuple[float, float]:
    """Mean and standard deviation of the roll, from `hang`, of boards in general.

    People hold a board near one of two angles, whose mean is `hang`, and roll it from there.
    """
    apart = 0.0 if upper_corner else 0.5 * abs(math.atan2(edges[0], edges[1]) - math.radians(45.0))
    return 0.0, math.hypot(_ROLL_SIGMA, apart)


def _agreement(counts: Contradictions, wrong: float) -> float:
    """Log odds that returns of which a share ``wrong`` contradicts boards are a board's, and do not lie by chance."""
    on_board = counts.returns * math.log((1.0 - wrong) / (1.0 - _BY_CHANCE))
    return on_board - counts.against * math.log(_BY_CHANCE / wrong)


def _within(most: float, mean: float, variance: float) -> float:
    """Probability that a normal variable lies between -most and most."""
    wide = math.sqrt(2.0 * max(variance, 1e-12))
    return 0.5 * (math.erf((most - mean) / wide) + math.erf((most + mean) / wide))


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane w . X = 1 in a window's frame, and the rays that show where the board in this plane ends.

    Attributes:
        R_window_lidar: (3, 3) from the LiDAR frame to the window's.
        w: (3,) 1/m, normal of the plane over its distance.
        spread: (3, 3) covariance of w, from each point's own error.
        uneven: (3, 3) what the rings' own errors add to it.
        score: log likelihood of the points in it, against clutter.
        left, up: (N,) metres, where each ray meets the plane, from the foot of the sensor's perpendicular.
        reach: (N,) metres, distance from the sensor to that place.
        ratio: (N,) likelihood of the ray's return, or of none, with the board over that without the board.
        below: (N,) whether the ray meets the plane below the board's widest ring.
        mixed: (N,) whether the ray's return may be of both the board and something close behind it.
        hits: (2, H) metres to the left and up, of all returns that lie in the plane where the board was followed.
        misses: (3, M) of all returns from behind the plane, where a board that holds the hits may be: metres to the
            left and up, and 1 if the return may be of both the board and something close behind it, else 0.
        near: (3, K) of all returns in the plane where a board that holds the hits may be: metres to the left and up,
            and 1 if the return lies in the region and is not static, else 0.
        rings: how many rings meet the board.
        top_ring: the highest of these rings.
        points: how many points lie on the board.
        width: metres, of the board where it is widest on a ring.
        returned: (N,) whether the ray brought a return.
        telling: whether so many rings meet the board that a leg or a head hardly lies in its plane by chance.
    """

    R_window_lidar: Floats
    w: Floats
    spread: Floats
    uneven: Floats
    score: float
    left: Floats
    up: Floats
    reach: Floats
    ratio: Floats
    below: NDArray[np.bool_]
    mixed: NDArray[np.bool_]
    hits: Floats
    misses: Floats
    near: Floats
    rings: int
    top_ring: int
    points: int
    width: float
    returned: NDArray[np.bool_]
    telling: bool

    def believed(self, model: BoardModel) -> Floats:
        """(N,) `ratio`, where some rays look as if they were on an edge's other side."""
        beside = np.where(self.below, model.wrong_below, model.wrong)
        on_board = (1.0 - model.wrong) * self.ratio + model.wrong
        believed: Floats = on_board / (1.0 - beside + beside * self.ratio)
        return believed

    @property
    def held(self) -> bool:
        """Whether somebody who shows a board to the sensor may turn and lean it so."""
        slopes = -self.w[1:] / self.w[0]
        towards = np.column_stack([-slopes, -np.eye(2)]) / self.w[0]
        variances = np.diag(towards @ self.spread @ towards.T).tolist()
        likely = [
            _within(most, slope, variance)
            for most, slope, variance in zip((_MOST_YAW, _MOST_TILT), slopes.tolist(), variances, strict=True)
        ]
        return min(likely) > _HARDLY

    @property
    def like_a_person(self) -> bool:
        """Whether it may be a person's trunk and legs: on few rings, and no wider."""
        return not self.telling and self.width < TRUNK_M


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A plane, its window, and for each ring the board's first and last column there: (R, 2), -1 for none."""

    plane: Plane
    window: RangeImage
    ends: NDArray[np.int64]


class Contradictions(NamedTuple):
    """How many returns contradict a board, and how many lie on its plane, or at its edges, in all."""

    against: int
    returns: int


class Way(NamedTuple):
    """A way to hold the board: its share of the posterior, and in it (left, up, fall) of the apex.

    edges: metres, to the lower left and to the lower right. mean (3,), covariance (3, 3): metres, metres, radians.
    """

    weight: float
    edges: tuple[float, float]
    mean: Floats
    covariance: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Fix:
    """The apex as a plane's rays determine it.

    Attributes:
        xyz: (3,) metres, LiDAR frame.
        covariance: (3, 3) of azimuth, elevation (rad) and range (m).
        sigma: radians, standard deviation, azimuth and elevation together, from the sweep's own rays: without errors
            that all sweeps share.
        roll, roll_sigma: radians from `hang`, and its standard deviation.
        fall: radians by which the edge to the lower left falls.
        returns: above and below the board's side corners, of the returns in its plane. Those outside of the board
            contradict it, and so do those off its plane inside.
        within: share of the returns in its plane that lie on the board, not beside it where its edges seem to be.
        at_edges: as `returns`, of the edges' returns alone.
        best: log likelihood of the rays for the likeliest board, 0 if every ray is as expected.
        expected: this log likelihood if the board is there and the sensor is as learned.
        evidence: log of the rays' likelihood, averaged over the prior.
        wrong: share of the returns that contradict this recording's boards, above and below their side corners.
        told: (2, G) log likelihood of the rays at each of `ROLLS`, for the first edge to the lower left and for the
            second there; minus infinity far from the likeliest rolls, and in a way to hold the board that was left
            out because the other is so much likelier.
        ways: the posterior by the way to hold the board, without errors that all sweeps share.
        upper_corner: see `BoardModel.upper_corner`.
        moving: of a board with level edges, the share of its returns that lie in the region and are not static.
    """

    plane: Plane
    xyz: Floats
    covariance: Floats
    sigma: float
    roll: float
    roll_sigma: float
    fall: float
    returns: tuple[Contradictions, Contradictions]
    within: float
    at_edges: tuple[Contradictions, Contradictions]
    best: float
    expected: float
    evidence: float
    wrong: tuple[float, float]
    told: Floats
    ways: tuple[Way, ...]
    upper_corner: int
    moving: float

    @property
    def explained(self) -> bool:
        """Whether the returns agree with a board rather than with none, and somebody may hold it so.

        On few rings the rays must also be nearly as likely as noise alone makes them. On more rings even a real
        board's rays are less likely than that, because it bends and hands hold it: only contradictions count there.
        They must be likelier on this recording's boards than by chance. On any number of rings most returns must lie
        on the board, not in the rim by which a beam's width makes it larger.
        """
        if not self.held or self.within < MOST_ON_BOARD:
            return False
        if not self.plane.telling:
            as_learned = self.best >= _LEAST_LIKELY + _TIMES_EXPECTED * self.expected
            return as_learned and self.against < _CONTRADICTED * (self.plane.points + self.against)
        return sum(map(_agreement, self.returns, self.wrong)) > 0.0

    @property
    def explained_above(self) -> bool:
        """Whether what lies above the side corners agrees with a board; below them a body may answer in its plane."""
        return self.held and self.plane.telling and _agreement(self.returns[0], self.wrong[0]) > 0.0

    @property
    def against(self) -> int:
        """How many returns contradict the board."""
        return sum(part.against for part in self.returns)

    @property
    def held(self) -> bool:
        """Whether somebody may hold a board so. Doors, cars and walls have upright edges, and a tip has none."""
        if not self.plane.held:
            return False
        middle = math.radians(45.0) * (1 + self.upper_corner)
        most = math.radians(45.0) - _UPRIGHT
        likely = [
            way.weight * _within(most, float(way.mean[2]) - middle, float(way.covariance[2, 2])) for way in self.ways
        ]
        return sum(likely) > _HARDLY

    @property
    def trustworthy(self) -> bool:
        """Whether the neighbours of its sweep, and what is learned, may rest on it."""
        return self.explained and not self.plane.like_a_person and self.sigma < _TRUSTED_RAD

    @property
    def support(self) -> float:
        """Log likelihood of points and rays together, for comparing planes of one sweep."""
        return self.evidence + self.plane.score

    @property
    def sigma_azimuth(self) -> float:
        """Radians."""
        return math.sqrt(self.covariance[0, 0])

    @property
    def sigma_elevation(self) -> float:
        """Radians."""
        return math.sqrt(self.covariance[1, 1])
