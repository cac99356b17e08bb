"""A plane that may be the board's, and what the sensor measured around it.

`candidate_search` finds these in a sweep's range image, and `estimate` looks for the board in each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.model import BoardModel, Floats
from workers.vertices.range_image import RangeImage

Mask = NDArray[np.bool_]
# By chance a board and a leg, or a head, can lie in one plane on two or three rings, but hardly on more.
MANY_RINGS = 4
# Breadth of the hips of a standing man, 95th percentile (DIN 33402-2); the trunk is no broader.
TRUNK_M = 0.4
# People show boards turned by up to 60 degrees and lean them by 35; planes are 5 degrees off at most.
_MOST_YAW, _MOST_TILT = math.tan(math.radians(65.0)), math.tan(math.radians(40.0))
HARDLY = 0.025  # two standard deviations on one side


def probability_within(most: float, mean: float, variance: float) -> float:
    """Return the probability that a normal variable lies between -most and most."""
    wide = math.sqrt(2.0 * max(variance, 1e-12))
    return 0.5 * (math.erf((most - mean) / wide) + math.erf((most + mean) / wide))


@dataclass(frozen=True, slots=True, eq=False)
class EdgeRays:
    """The N rays that show where a plane's board ends: the last ones on it and the first ones beside it.

    Attributes:
        left, up: (N,) metres, where each ray meets the plane, from the foot of the sensor's perpendicular.
        reach: (N,) metres, distance from the sensor to that point.
        ratio: (N,) likelihood of the ray's return, or dropout, with the board over that without the board.
        is_below: (N,) whether the ray meets the plane below the board's widest ring.
        is_mixed: (N,) whether the ray's return may be of both the board and something close behind it.
        has_return: (N,) whether the ray brought a return.
    """

    left: Floats
    up: Floats
    reach: Floats
    ratio: Floats
    is_below: Mask
    is_mixed: Mask
    has_return: Mask

    def contaminated_ratio(self, model: BoardModel) -> Floats:
        """Return (N,) `ratio` if a share of the rays is contaminated: it looks as if on an edge's other side."""
        beside = np.where(self.is_below, model.wrong_below, model.wrong)
        on_board = (1.0 - model.wrong) * self.ratio + model.wrong
        contaminated: Floats = on_board / (1.0 - beside + beside * self.ratio)
        return contaminated


@dataclass(frozen=True, slots=True, eq=False)
class PlaneReturns:
    """All returns, not only at the edges, that speak for or against a board in a plane.

    Attributes:
        hits: (2, H) metres to the left and up, of the returns in the plane where the board was followed.
        misses: (3, M) of the returns from behind the plane where a board that holds the hits may be: metres to the
            left and up, and 1 if the return may be of both the board and something close behind it, else 0.
        near: (3, K) of the returns in the plane where a board that holds the hits may be: metres to the left and up,
            and 1 if the return lies in the region and is not static, else 0.
        inner: (3, I) of the hits that are not among the plane's rays: metres to the left and up, and the ray's ratio.
    """

    hits: Floats
    misses: Floats
    near: Floats
    inner: Floats


@dataclass(frozen=True, slots=True)
class PlaneExtent:
    """The part of a plane that the sensor meets.

    Attributes:
        rings: how many rings meet the board.
        top_ring: the highest of these rings.
        points: how many points lie on the board.
        width: metres, of the board where it is widest on a ring.
        has_many_rings: whether so many rings meet the board (without rings: so many points lie on it) that a leg or
            a head hardly lies in its plane by chance.
    """

    rings: int
    top_ring: int
    points: int
    width: float
    has_many_rings: bool

    @property
    def is_like_a_person(self) -> bool:
        """Whether this may be a person's trunk and legs: on few rings, and no wider."""
        return not self.has_many_rings and self.width < TRUNK_M


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A plane w . X = 1 in a window's frame that may be the board's, and what the sensor measured around it.

    Attributes:
        R_window_lidar: (3, 3) from the LiDAR frame to the window's.
        w: (3,) 1/m, normal of the plane over its distance.
        covariance: (3, 3) of w, from each point's own error.
        ring_covariance: (3, 3) added to it by the rings' own errors.
        score: log likelihood of the points in it, against clutter.
        rays: at the board's edges.
        returns: on the board and around it.
        extent: how much of it the sensor meets.
    """

    R_window_lidar: Floats
    w: Floats
    covariance: Floats
    ring_covariance: Floats
    score: float
    rays: EdgeRays
    returns: PlaneReturns
    extent: PlaneExtent

    @property
    def has_usual_slopes(self) -> bool:
        """Whether somebody who shows a board to the sensor may turn and lean it so."""
        slopes = -self.w[1:] / self.w[0]
        towards = np.column_stack([-slopes, -np.eye(2)]) / self.w[0]
        variances = np.diag(towards @ self.covariance @ towards.T).tolist()
        likely = [
            probability_within(most, slope, variance)
            for most, slope, variance in zip((_MOST_YAW, _MOST_TILT), slopes.tolist(), variances, strict=True)
        ]
        return min(likely) > HARDLY


@dataclass(frozen=True, slots=True, eq=False)
class PlaneCandidate:
    """A plane, its window, and for each ring the board's first and last column there: (R, 2), -1 for none."""

    plane: Plane
    window: RangeImage
    ends: NDArray[np.int64]
