"""Errors that all pairs of a fit share: consider parameters (Schmidt 1966; Tapley, Schutz and Born 2004, ch. 6).

They are not estimated, because pairs hardly distinguish them from the mount. Each enters the covariance with its
stated standard deviation, as C + K S K^T.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.geometry.spherical import axes
from workers.solver.error_model import ErrorModel, weighed
from workers.solver.outcomes import SolveError
from workers.solver.problem import FitProblem
from workers.solver.residuals import by_point, transform_of

Floats = NDArray[np.float64]
DECENTRED: Final = 0.002
"""One standard deviation of a tangential term. Published lenses have, as root mean squares, 0.0012 (KITTI's four
cameras, Geiger et al. 2013), 0.0001 (EuRoC's two, Burri et al. 2016), 0.0034 (TUM RGB-D's two, Sturm et al. 2012)."""


def common_errors(problem: FitProblem, p: Floats) -> tuple[Floats, tuple[str, ...]]:
    """(N, 2, m) derivative of a whitened problem's residuals at p (D,), px per standard deviation; and m names."""
    names = tuple(name for name in _SHAPES if problem.common_errors.get(name))
    columns = [column_of(problem, p, name) * problem.common_errors[name] for name in names]
    return np.concatenate([np.zeros((len(problem.points), 2, 0)), *columns], axis=2), names


def column_of(problem: FitProblem, p: Floats, name: str) -> Floats:
    """(N, 2, 1) derivative of a whitened problem's residuals by that error, px per its unit."""
    return weighed(problem, _SHAPES[name](problem, p)[:, :, None])


def beside_decentring(problem: FitProblem, p: Floats, errors: ErrorModel) -> ErrorModel:
    """Return the errors of a whitened problem's estimate p (D,) for a lens that is off its axis by an unknown amount.

    The fisheye that other programs have lacks tangential terms, and its mount and centre take their part. They are
    estimated beside it (p1, p2 in the plane of theta, as in COLMAP's THIN_PRISM_FISHEYE): two parameters more, and
    what they would move the estimate by as a deviation. The same errors for other lenses or with a locked centre.
    """
    centre = [problem.names.index(name) for name in ("c_x", "c_y")]
    if problem.model != "kannala_brandt" or not np.isin(centre, problem.free).any():
        return errors
    x, y, z = transform_of(problem, p).apply(problem.points).T
    r = np.maximum(np.hypot(x, y), 1e-12)
    a, b = np.arctan2(r, z) * np.stack([x, y]) / r
    s = a * a + b * b
    by_term = np.array([[2.0 * a * b, s + 2.0 * a * a], [s + 2.0 * b * b, 2.0 * a * b]]) * p[6:8, None, None]
    wider = errors.with_columns(weighed(problem, np.moveaxis(by_term, 2, 0)), DECENTRED)
    step = wider.step()
    return replace(wider, moved=step + np.pad(errors.moved, (0, len(step) - errors.moved.size)))


def _by_direction(axis: int, in_mm: bool = False) -> Callable[[FitProblem, Floats], Floats]:
    def shape(problem: FitProblem, p: Floats) -> Floats:
        along = axes(problem.points)[:, :, axis]
        scale = 1e-3 / np.linalg.norm(along, axis=1, keepdims=True) if in_mm else np.radians(1.0)
        return np.einsum("nij,nj->ni", by_point(problem, p), scale * along)

    return shape


def _by_mark(axis: int) -> Callable[[FitProblem, Floats], Floats]:
    def shape(problem: FitProblem, p: Floats) -> Floats:
        return np.tile(-np.eye(2)[axis], (len(problem.points), 1))

    return shape


def _by_clock(problem: FitProblem, p: Floats) -> Floats:
    # A later camera clock looks at an earlier moment of the walk.
    if problem.velocities is None:
        raise SolveError(
            "no_motion",
            "The pairs do not say how the apex moved, so nothing follows from the clocks' deviation.",
            "Give stamp_ns of pairs from a walk, or leave clock_ms and line_time_us out of common_errors.",
        )
    return -1e-3 * np.einsum("nij,nj->ni", by_point(problem, p), problem.velocities)


def _by_row(problem: FitProblem, p: Floats) -> Floats:
    return -1e-3 * problem.rows_below[:, None] * _by_clock(problem, p)


_SHAPES: Final[dict[str, Callable[[FitProblem, Floats], Floats]]] = {
    "azimuth_deg": _by_direction(0),
    "elevation_deg": _by_direction(1),
    # A board that is carried upright faces the LiDAR: its plane's axes are those of azimuth and elevation.
    "tip_across_mm": _by_direction(0, in_mm=True),
    "tip_up_mm": _by_direction(1, in_mm=True),
    "range_mm": _by_direction(2, in_mm=True),
    "mark_u_px": _by_mark(0),
    "mark_v_px": _by_mark(1),
    "clock_ms": _by_clock,
    "line_time_us": _by_row,
}
