"""Least squares over a camera and the offset between its clock and the LiDAR's, for `clock_offset`.

The unknowns are those of the camera and, last, the offset in seconds. A mark belongs to its frame's own stamp, and at
that moment the apex was at track(stamp - offset), so d pixel / d offset is the apex's velocity, negated, through the
projection's Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workers.solver.outcomes import Outcome
from workers.solver.problem import FitProblem
from workers.solver.residuals import residuals_and_jacobian, transform_of

Floats = NDArray[np.float64]
_NODE_S: Final = 0.05  # the track is looked up this finely, and interpolated by its velocity in between
_MOST_STEPS: Final = 60
_TOLERANCE: Final = 1e-8  # relative decrease of the cost below which a fit has settled
_STUCK: Final = 1e8  # damping at which no step is left


class TipPositions(Protocol):
    """The apex at M moments: metres, metres per second, square metres (LiDAR frame), time to the nearest vertex."""

    @property
    def xyz(self) -> Floats: ...
    @property
    def velocity(self) -> Floats: ...
    @property
    def covariance_xyz(self) -> Floats: ...
    @property
    def gap_ns(self) -> NDArray[np.int64]: ...


class TipTrack(Protocol):
    """The apex's path over the LiDAR's clock."""

    def at(self, times_ns: ArrayLike) -> TipPositions: ...


@dataclass(frozen=True, eq=False)
class Marks:
    """N marks, and where the apex was at their moments under each of K offsets.

    Attributes:
        pixels: (N, 2).
        offsets_s: (K,) even steps, seconds from the middle of the search.
        xyz, velocity: (K, N, 3) metres and metres per second, LiDAR frame.
        covariance: (K, N, 3, 3) square metres.
        gap_s: (K, N) seconds to the nearest vertex.
    """

    pixels: Floats
    offsets_s: Floats
    xyz: Floats
    velocity: Floats
    covariance: Floats
    gap_s: Floats

    @classmethod
    def of(cls, track: TipTrack, stamps_ns: NDArray[np.int64], pixels: Floats, about_ns: int, search_ns: int) -> Self:
        """Look the track up at stamps (N,) less every offset within about_ns +- search_ns."""
        count = max(2, 2 * round(search_ns * 1e-9 / _NODE_S) + 1)
        offsets_ns = np.linspace(-search_ns, search_ns, count).round().astype(np.int64)
        looked_up = track.at((stamps_ns - about_ns - offsets_ns[:, None]).reshape(-1))
        shape = (count, len(stamps_ns))
        return cls(
            pixels=pixels,
            offsets_s=offsets_ns.astype(np.float64) * 1e-9,
            xyz=looked_up.xyz.reshape(*shape, 3),
            velocity=looked_up.velocity.reshape(*shape, 3),
            covariance=looked_up.covariance_xyz.reshape(*shape, 3, 3),
            gap_s=looked_up.gap_ns.reshape(shape).astype(np.float64) * 1e-9,
        )

    def nearest(self, offset_s: float) -> int:
        """The node whose offset is nearest."""
        return int(np.argmin(np.abs(self.offsets_s - offset_s)))

    def points(self, offset_s: float) -> tuple[Floats, Floats]:
        """(N, 3) where the apex was, and (N, 3) its derivative by the offset, metres per second (cubic Hermite)."""
        step = float(self.offsets_s[1] - self.offsets_s[0])
        k = int(np.clip((offset_s - self.offsets_s[0]) // step, 0, len(self.offsets_s) - 2))
        s = (offset_s - float(self.offsets_s[k])) / step
        p0, p1 = self.xyz[k], self.xyz[k + 1]
        # A later clock looks at an earlier moment.
        m0, m1 = -step * self.velocity[k], -step * self.velocity[k + 1]
        chord, bend = p1 - p0, m0 + m1 - 2.0 * (p1 - p0)
        lean = 3.0 * chord - 2.0 * m0 - m1
        return p0 + s * (m0 + s * (lean + s * bend)), (m0 + s * (2.0 * lean + 3.0 * s * bend)) / step


@dataclass(frozen=True, eq=False)
class MarksUnder:
    """The marks under one set of unknowns (D,): residuals in px and their derivatives.

    Attributes:
        residuals: (N, 2) projection minus mark.
        jacobian: (N, 2, D), in the order camera, offset.
        by_point: (N, 2, 3) d pixel / d apex, px per metre, LiDAR frame.
    """

    residuals: Floats
    jacobian: Floats
    by_point: Floats

    def speed_px_s(self) -> Floats:
        """(N,) how fast the apex moves in the image."""
        return np.linalg.norm(self.jacobian[:, :, -1], axis=1)


def marks_under(problem: FitProblem, marks: Marks, x: Floats) -> MarksUnder:
    """The marks under camera parameters and offset x (D,)."""
    points, by_offset = marks.points(float(x[-1]))
    flat, J = residuals_and_jacobian(replace(problem, points=points), x[:-1], walls=False)
    n = len(points)
    by_camera = J.reshape(n, 2, -1)
    by_point: Floats = np.einsum("nij,jk->nik", by_camera[:, :, 3:6], transform_of(problem, x[:-1]).R)
    moved: Floats = np.einsum("nij,nj->ni", by_point, by_offset)
    return MarksUnder(flat.reshape(n, 2), np.concatenate([by_camera, moved[:, :, None]], axis=2), by_point)


def whitening(problem: FitProblem, marks: Marks, here: MarksUnder, offset_s: float) -> Floats:
    """(N, 2, 2) inverse Cholesky factors of the marks' own covariance and the track's, as the image sees it."""
    track = marks.covariance[marks.nearest(offset_s)]
    spread: Floats = np.einsum("nij,njk,nlk->nil", here.by_point, track, here.by_point)
    spread += problem.mark_sigma_px**2 * np.eye(2)
    return np.linalg.inv(np.linalg.cholesky(spread)).astype(np.float64)


def scores(problem: FitProblem, marks: Marks, x: Floats) -> Floats:
    """(N,) distances of the marks from x (D,), in standard deviations."""
    here = marks_under(problem, marks, x)
    W = whitening(problem, marks, here, float(x[-1]))
    return np.linalg.norm(np.einsum("nij,nj->ni", W, here.residuals), axis=1)


class OffsetFit(NamedTuple):
    """The unknowns x (D,) of camera and offset, and how their fit ended."""

    x: Floats
    outcome: Outcome


def fit_offset(problem: FitProblem, marks: Marks, x: Floats, counted: NDArray[np.bool_], robust: bool) -> OffsetFit:
    """Least squares of the kept marks from x (D,), whitened as at x.

    Levenberg and Marquardt's method (Nocedal and Wright 2006, ch. 10) inside the problem's bounds; robust: with
    Cauchy's weights, found anew at every step.
    """
    W = whitening(problem, marks, marks_under(problem, marks, x), float(x[-1]))
    lower = np.append(problem.lower, marks.offsets_s[0])
    upper = np.append(problem.upper, marks.offsets_s[-1])
    x = np.clip(x, lower, upper)
    cost, gradient, normal = _normal(problem, marks, x, W, counted, robust)
    damping = 1e-3
    for _ in range(_MOST_STEPS):
        problem.stop.check()
        # A parameter at its bound that would go on beyond it stays there.
        moves = (upper > lower) & ~((x <= lower) & (gradient > 0.0)) & ~((x >= upper) & (gradient < 0.0))
        size = np.sqrt(np.diag(normal)[moves])
        scaled = normal[np.ix_(moves, moves)] / size / size[:, None]
        step = np.zeros(len(x))
        step[moves] = -np.linalg.solve(scaled + damping * np.eye(len(size)), gradient[moves] / size) / size
        there = np.clip(x + step, lower, upper)
        new = _normal(problem, marks, there, W, counted, robust)
        if new[0] > cost:
            damping *= 8.0
            if damping > _STUCK:
                return OffsetFit(x, Outcome.NO_STEP_LEFT)
            continue
        settled = cost - new[0] <= _TOLERANCE * cost
        x, (cost, gradient, normal) = there, new
        damping = max(damping / 8.0, 1e-9)
        if settled:
            return OffsetFit(x, Outcome.CONVERGED)
    return OffsetFit(x, Outcome.OUT_OF_STEPS)


def _normal(
    problem: FitProblem, marks: Marks, x: Floats, W: Floats, counted: NDArray[np.bool_], robust: bool
) -> tuple[float, Floats, Floats]:
    """Half of what is minimised at x, its gradient (D,) and the normal matrix (D, D), with the priors."""
    here = marks_under(problem, marks, x)
    r: Floats = np.einsum("nij,nj->ni", W[counted], here.residuals[counted])
    J: Floats = np.einsum("nij,njk->nik", W[counted], here.jacobian[counted])
    square = np.sum(r * r, axis=1)
    weight = 1.0 / (1.0 + square) if robust else np.ones(len(square))
    loss = np.log1p(square) if robust else square
    mean, strength = weak_priors(problem)
    off = strength * (x[:-1] - mean)
    rows = (J * np.sqrt(weight)[:, None, None]).reshape(-1, len(x))
    gradient = rows.T @ (r * np.sqrt(weight)[:, None]).reshape(-1)
    gradient[:-1] += strength * off
    # An undetermined parameter does not move.
    normal = rows.T @ rows + np.diag(np.append(strength**2, 0.0) + 1e-12)
    return 0.5 * float(np.sum(loss) + off @ off), gradient, normal


def weak_priors(problem: FitProblem) -> tuple[Floats, Floats]:
    """(D,) mean and 1 / sigma of the camera's priors; the width of its bounds where a parameter has none.

    A parameter that the marks do not determine then lies in the middle of its bounds and says how little is known.
    """
    width = problem.upper - problem.lower
    mean = 0.5 * (problem.lower + problem.upper)
    strength = np.where(width > 0.0, np.sqrt(12.0) / np.maximum(width, 1e-300), 0.0)
    for name, (centre, sigma) in problem.priors.items():
        index = problem.names.index(name)
        mean[index], strength[index] = centre, 1.0 / sigma
    return mean, strength
