# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
"""Least squares over a camera and the offset between its clock and the LiDAR's, for `clock_offset`.

The unknowns are those of the camera and, last, the offset in seconds. A mark belongs to its frame's own stamp, and at
that moment the apex was at track(stamp - offset), so d pixel / d offset is the apex's velocity, negated, through the
projection's Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from workers.solver.problem import FitProblem
from workers.solver.residuals import residuals_and_jacobian, transform_of

Floats = NDArray[np.float64]
# scipy publishes no types.
_least_squares: Callable[..., Any] = optimize.least_squares
_NODE_S: Final = 0.025  # the track is looked up this finely, and interpolated by its velocity in between


class TrackPoints(Protocol):
    """The apex at M moments: metres, metres per second, square metres (LiDAR frame), time to the nearest vertex."""

    @property
    def xyz(self) -> Floats: ...
    @property
    def velocity(self) -> Floats: ...
    @property
    def covariance_xyz(self) -> Floats: ...
    @property
    def gap_ns(self) -> NDArray[np.int64]: ...


class Track(Protocol):
    """Where the apex was at any moment of the LiDAR's clock."""

    def at(self, times_ns: ArrayLike) -> TrackPoints: ...


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
    def of(cls, track: Track, stamps_ns: NDArray[np.int64], pixels: Floats, about_ns: int, search_ns: int) -> Self:
        """Look the track up at stamps (N,) less every offset within about_ns +- search_ns."""
        count = max(2, 2 * round(search_ns * 1e-9 / _NODE_S) + 1)
        offsets_ns = np.linspace(-search_ns, search_ns, count).round().astype(np.int64)
        found = track.at((stamps_ns - about_ns - offsets_ns[:, None]).reshape(-1))
        shape = (count, len(stamps_ns))
        return cls(
            pixels=pixels,
            offsets_s=offsets_ns.astype(np.float64) * 1e-9,
            xyz=found.xyz.reshape(*shape, 3),
            velocity=found.velocity.reshape(*shape, 3),
            covariance=found.covariance_xyz.reshape(*shape, 3, 3),
            gap_s=found.gap_ns.reshape(shape).astype(np.float64) * 1e-9,
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
class Look:
    """The marks under one set of unknowns (D,): residuals in px and their derivatives.

    Attributes:
        residuals: (N, 2) projection minus mark.
        jacobian: (N, 2, D), in the order camera, offset.
        whitening: (N, 2, 2) inverse Cholesky factors: residuals times them have unit covariance.
    """

    residuals: Floats
    jacobian: Floats
    whitening: Floats

    def distances(self) -> Floats:
        """(N,) lengths of the whitened residuals: standard deviations."""
        return np.linalg.norm(np.einsum("nij,nj->ni", self.whitening, self.residuals), axis=1)

    def speed_px_s(self) -> Floats:
        """(N,) how fast the apex moves in the image."""
        return np.linalg.norm(self.jacobian[:, :, -1], axis=1)


def look(problem: FitProblem, marks: Marks, x: Floats) -> Look:
    """The marks under camera parameters and offset x (D,), whitened by the marks' noise and the track's."""
    points, by_offset = marks.points(float(x[-1]))
    here = replace(problem, points=points)
    flat, J = residuals_and_jacobian(here, x[:-1], walls=False)
    n = len(points)
    residuals, by_camera = flat.reshape(n, 2), J.reshape(n, 2, -1)
    by_point = by_camera[:, :, 3:6] @ transform_of(problem, x[:-1]).R
    moved: Floats = np.einsum("nij,nj->ni", by_point, by_offset)
    spread: Floats = by_point @ marks.covariance[marks.nearest(float(x[-1]))] @ by_point.swapaxes(1, 2)
    spread += problem.mark_sigma_px**2 * np.eye(2)
    jacobian = np.concatenate([by_camera, moved[:, :, None]], axis=2)
    whitening: Floats = np.linalg.inv(np.linalg.cholesky(spread))
    return Look(residuals, jacobian, whitening)


def fit(problem: FitProblem, marks: Marks, x: Floats, kept: NDArray[np.bool_], robust: bool) -> Floats:
    """Least squares (robust: Cauchy) of the kept marks from x (D,), whitened as at x; returns the unknowns."""
    whitening = look(problem, marks, x).whitening[kept]
    free = np.append(problem.free, len(x) - 1)
    lower = np.append(problem.lower, marks.offsets_s[0])[free]
    upper = np.append(problem.upper, marks.offsets_s[-1])[free]
    margin = 1e-9 * (upper - lower)
    mean, strength = prior_rows(problem)

    def full(values: Floats) -> Floats:
        y = x.copy()
        y[free] = values
        return y

    def residuals(values: Floats) -> Floats:
        y = full(values)
        white = np.einsum("nij,nj->ni", whitening, look(problem, marks, y).residuals[kept])
        return np.concatenate([white.reshape(-1), strength * (y[:-1] - mean)])

    def jacobian(values: Floats) -> Floats:
        white = whitening @ look(problem, marks, full(values)).jacobian[kept]
        rows = np.column_stack([np.diag(strength), np.zeros(len(strength))])
        return np.concatenate([white.reshape(-1, len(x)), rows])[:, free]

    found = _least_squares(
        residuals,
        np.clip(x[free], lower + margin, upper - margin),
        jac=jacobian,
        bounds=(lower, upper),
        x_scale="jac",
        ftol=1e-10,
        xtol=1e-10,
        gtol=1e-10,
        max_nfev=60,
        loss="cauchy" if robust else "linear",
    )
    return full(found.x)


def prior_rows(problem: FitProblem) -> tuple[Floats, Floats]:
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
