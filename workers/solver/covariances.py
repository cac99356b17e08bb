# pyright: reportMissingTypeStubs=false
"""Stated covariances of pairs: of the vertex in the LiDAR's frame, and of the mark in the image."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from apexcal.documents.pairs import MARK_SIGMA, SIGMAS, states_errors
from workers.geometry.spherical import to_xyz
from workers.solver.outcomes import SolveError

Floats = NDArray[np.float64]
Column = Sequence[float | None] | NDArray[Any]
# scipy publishes no types.
_chi_square_beyond: Callable[[Floats, float], Floats] = special.chdtri
COLUMNS: Final = (*SIGMAS, MARK_SIGMA, "marks", "spread_px")
# With fewer pairs of several marks the scatter of marks cannot be estimated.
_ENOUGH_PAIRS: Final = 10
_FLOOR_PX: Final = 0.1


@dataclass(frozen=True, eq=False)
class Covariances:
    """Covariances of N pairs' errors, independent from pair to pair.

    points (N, 3, 3): of the vertex over x, y, z in the LiDAR frame, square metres (zero where it is exact).
    marks (N, 2, 2): of the mark over u, v, square pixels.
    Raises SolveError `bad_covariances` for another shape, a number that is not finite, or a matrix that is no
    covariance (not symmetric, a negative variance; a mark's must be above 0).
    """

    points: Floats
    marks: Floats

    def __post_init__(self) -> None:
        n = len(self.marks)
        if self.points.shape != (n, 3, 3) or self.marks.shape != (n, 2, 2):
            raise SolveError(
                "bad_covariances",
                f"Covariances of points {self.points.shape} and marks {self.marks.shape} do not belong together.",
                "Those of points are (N, 3, 3), those of marks (N, 2, 2).",
            )
        for what, matrices, smallest in (("point", self.points, -1e-9), ("mark", self.marks, 1e-12)):
            bad = _no_covariances(matrices, smallest)
            if bad.size:
                raise SolveError(
                    "bad_covariances",
                    f"The covariance of the {what} of pair {bad[0]} is none: {matrices[bad[0]].tolist()}.",
                    "It must be finite, symmetric and without negative variances; a mark's must be above 0.",
                )

    def of(self, rows: Sequence[int]) -> Covariances:
        """Return the covariances of the pairs at these rows."""
        return Covariances(self.points[rows], self.marks[rows])


def covariances_of(columns: Mapping[str, Column], points: ArrayLike, mark_sigma_px: float) -> Covariances:
    """Return the covariances of pairs as a correspondence set states them.

    columns: `sigma_azimuth_rad`, `sigma_elevation_rad` (radians) and `sigma_range_m` (metres) of the vertices, and
    `sigma_px` of the marks per coordinate (pixels), each of N numbers; None for a mark that states no deviation.
    points (N, 3): metres, LiDAR frame. A mark without a deviation has mark_sigma_px if it is one person's, or what
    the spread of several people's marks shows (columns `marks`, `spread_px`); a consensus of n marks has 1 / n of the
    variance. Raises SolveError `no_covariances` if the columns state none, `bad_covariances` if they cannot be any.
    """
    xyz = np.asarray(points, dtype=np.float64)
    if not states_errors(columns):
        raise SolveError(
            "no_covariances",
            "The pairs state no standard deviations, so nothing says how they should weigh.",
            f"Give {', '.join(SIGMAS)} or {MARK_SIGMA} for all pairs, or ask for equal weights.",
        )
    spherical = np.zeros((len(xyz), 3, 3))
    if all(name in columns for name in SIGMAS):
        spherical[:, range(3), range(3)] = (
            np.column_stack([np.asarray(columns[name], dtype=np.float64) for name in SIGMAS]) ** 2
        )
    variance = _mark_variance(columns, len(xyz), mark_sigma_px)
    return Covariances(to_xyz(spherical, xyz), variance[:, None, None] * np.eye(2))


def _mark_variance(columns: Mapping[str, Column], n: int, mark_sigma_px: float) -> Floats:
    if MARK_SIGMA in columns:
        stated = np.asarray(columns[MARK_SIGMA], dtype=np.float64)
        others = {name: column for name, column in columns.items() if name != MARK_SIGMA}
        return np.where(np.isnan(stated), _mark_variance(others, n, mark_sigma_px), stated**2)
    if "marks" not in columns:
        return np.full(n, mark_sigma_px**2)
    count = np.maximum(np.asarray(columns["marks"], dtype=np.float64), 1.0)
    spread = np.asarray(columns.get("spread_px", np.zeros(n)), dtype=np.float64)
    several = count > 1.0
    sigma_px = mark_sigma_px
    if np.count_nonzero(several) >= _ENOUGH_PAIRS:
        # n spread^2 is sigma^2 times a chi-square of 2 (n - 1); by its median, because people also mark wrong things.
        freedom = 2.0 * (count[several] - 1.0)
        middle = _chi_square_beyond(freedom, 0.5)
        sigma_px = max(_FLOOR_PX, float(np.sqrt(np.median(count[several] * spread[several] ** 2 / middle))))
    return sigma_px**2 / count


def _no_covariances(matrices: Floats, smallest: float) -> NDArray[np.int64]:
    finite: NDArray[np.bool_] = np.all(np.isfinite(matrices), axis=(1, 2))
    safe = np.where(finite[:, None, None], matrices, np.eye(matrices.shape[1]))
    scale = np.abs(safe).max(axis=(1, 2)) + 1e-300
    skewed = np.abs(safe - safe.swapaxes(1, 2)).max(axis=(1, 2)) > 1e-9 * scale
    return np.flatnonzero(~finite | skewed | (np.linalg.eigvalsh(safe)[:, 0] < smallest * np.maximum(scale, 1e-9)))
