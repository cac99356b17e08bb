"""Errors that all pairs of a fit share: consider parameters (Schmidt 1966; Tapley, Schutz and Born 2004, ch. 6).

They are not estimated, because pairs hardly distinguish them from the mount. Each enters the covariance with its
stated standard deviation, as C + K S K^T. All marks of a person are off by the same shift. The pairs cannot tell the
mean shift of all people from the mount. But if several people marked, the differences tell how large shifts are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.pairs import MARKED_BY
from apexcal.documents.precision import PersonBias
from workers.geometry.spherical import axes
from workers.solver.error_model import ErrorModel, weighed
from workers.solver.outcomes import SolveError
from workers.solver.problem import FitProblem
from workers.solver.residuals import by_point, transform_of

Floats = NDArray[np.float64]
DECENTRED: Final = 0.002
"""One standard deviation of a tangential term. Published lenses have, as root mean squares, 0.0012 (KITTI's four
cameras, Geiger et al. 2013), 0.0001 (EuRoC's two, Burri et al. 2016), 0.0034 (TUM RGB-D's two, Sturm et al. 2012)."""
STATED_FREEDOM: Final = 4.5
"""Degrees of freedom of a deviation that is known to a third: 1 / (2 (1/3)^2) (JCGM 100:2008, equation G.3)."""
_LEAST_PAIRS: Final = 5.0  # fewer whole pairs of one person tell nothing of the shift
_GRID: Final = np.linspace(-6.0, 8.0, 281)  # ln of the variance over the stated one


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

    The fisheye model lacks tangential terms, as it does in other programs, so mount and centre take their place. Here
    two such terms are estimated, too (p1, p2 in the plane of theta, as in COLMAP's THIN_PRISM_FISHEYE). The step by
    which they would move the estimate is an error of it. Other lenses, or a locked centre, leave the errors as they
    are.
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


def _arms(problem: FitProblem) -> Floats:
    """(N, 3) from the middle of a pose's pairs to each, m; zero where no pose has several."""
    arms, blocks = np.zeros_like(problem.points), problem.blocks
    if blocks is None or blocks.kind != "group":
        return arms
    count = len(blocks.labels)  # of the marks that there are; planned ones may follow
    points = problem.points[:count]
    sums = np.zeros((int(blocks.labels.max()) + 1, 3))
    np.add.at(sums, blocks.labels, points)
    arms[:count] = points - (sums / np.bincount(blocks.labels)[:, None])[blocks.labels]
    return arms


def _by_tilt(axis: int) -> Callable[[FitProblem, Floats], Floats]:
    def shape(problem: FitProblem, p: Floats) -> Floats:
        along = axes(problem.points)[:, :, axis]
        turned = np.cross(along / np.linalg.norm(along, axis=1, keepdims=True), _arms(problem))
        return np.einsum("nij,nj->ni", by_point(problem, p), np.radians(1.0) * turned)

    return shape


def _by_corner(problem: FitProblem, p: Floats) -> Floats:
    arms = _arms(problem)
    outward = 1e-3 * arms / np.maximum(np.linalg.norm(arms, axis=1, keepdims=True), 1e-9)
    return np.einsum("nij,nj->ni", by_point(problem, p), outward)


def _by_mark(axis: int) -> Callable[[FitProblem, Floats], Floats]:
    def shape(problem: FitProblem, p: Floats) -> Floats:
        return np.tile(-np.eye(2)[axis], (len(problem.points), 1))

    return shape


def _by_clock(problem: FitProblem, p: Floats) -> Floats:
    # A later camera clock looks at an earlier moment of the walk.
    if problem.velocities is None:
        raise SolveError(
            "no_motion",
            "The pairs do not say how the corner moved, so nothing follows from the clocks' deviation.",
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
    "tilt_up_deg": _by_tilt(0),
    "tilt_across_deg": _by_tilt(1),
    "corners_out_mm": _by_corner,
    "mark_u_px": _by_mark(0),
    "mark_v_px": _by_mark(1),
    "clock_ms": _by_clock,
    "line_time_us": _by_row,
}


def shares_of(pairs: Mapping[str, Sequence[Any]]) -> Floats | None:
    """(N, P) share of each person in a set's pairs (columns); rows add up to 1. None where the pairs do not say."""
    markers = pairs.get(MARKED_BY)
    if markers is None:
        return None
    shares = np.zeros((len(markers), 1 + max((max(people) for people in markers if people), default=0)))
    for row, people in enumerate(markers):
        shares[row, people] = 1.0 / max(len(people), 1)
    return shares


def columns_of(problem: FitProblem, shares: Floats) -> Floats:
    """(N, 2, 2 P) derivative of a whitened problem's residuals by each person's shift along u and v."""
    n, people = shares.shape
    columns = np.zeros((n, 2, people, 2))
    columns[:, 0, :, 0] = columns[:, 1, :, 1] = -shares
    return weighed(problem, columns.reshape(n, 2, 2 * people))


def with_people(problem: FitProblem, errors: ErrorModel) -> tuple[ErrorModel, PersonBias | None]:
    """A whitened problem's errors (independent ones, and common ones) with the people's shifts, and these.

    The stated variance is the scale of an inverse chi-square of STATED_FREEDOM degrees of freedom, to which the
    likelihood of the differences between people is joined. Nothing is added if the problem states none.
    """
    stated_px = problem.common_errors.get("person_px", 0.0)
    if stated_px == 0.0:
        return errors, None
    shares = problem.people if problem.people is not None else np.ones((len(problem.points), 1))
    columns = columns_of(problem, shares)
    people = np.flatnonzero(np.sum(shares[problem.weights > 0.0], axis=0) >= _LEAST_PAIRS)
    px, freedom = stated_px, STATED_FREEDOM
    if len(people) > 1:
        px, freedom = _joined(*_differences(errors.of_pairs(), columns, people), stated_px)
    bias = PersonBias(px=px, freedom=freedom, people=shares.shape[1])
    both = np.concatenate([errors.common, bias.px * columns], axis=2)
    terms = errors.terms + ("person_px",) * columns.shape[2]
    estimated = columns.shape[2]
    return replace(errors, common=both, terms=terms, estimated=estimated, common_freedom=bias.freedom), bias


def _differences(errors: ErrorModel, columns: Floats, chosen: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Contrasts (2 (P - 1),) between the shifts of the people, of unit variance where shifts have it, and the
    covariance of their errors.
    """
    people = len(chosen)
    # Rows of an orthonormal basis of all vectors whose members add up to zero.
    contrasts = np.linalg.svd(np.eye(people) - 1.0 / people)[2][:-1]
    n = len(columns)
    of_people = columns.reshape(n, 2, -1, 2)[:, :, chosen]
    along = np.einsum("ncpa,kp->ncka", of_people, contrasts).reshape(n, 2, -1)
    wider = errors.with_columns(along)
    more = along.shape[2]
    return wider.step()[-more:], wider.covariance()[-more:, -more:]


def _joined(differences: Floats, covariance: Floats, stated_px: float) -> tuple[float, float]:
    """Deviation and degrees of freedom of the inverse chi-square that has the posterior's first two moments."""
    values, vectors = np.linalg.eigh(covariance)
    squares = (vectors.T @ differences) ** 2
    variance = stated_px**2 * np.exp(_GRID)
    total = variance[:, None] + np.maximum(values, 0.0)
    log_density = -0.5 * np.sum(np.log(total) + squares / total, axis=1)
    log_density -= 0.5 * STATED_FREEDOM * (_GRID + stated_px**2 / variance)
    density = np.exp(log_density - log_density.max())
    density /= density.sum()
    # The inverse variance has a gamma distribution of mean 1 / size^2 and variance 2 / (freedom size^4).
    mean = float(density @ (1.0 / variance))
    spread = float(density @ (1.0 / variance - mean) ** 2)
    return float(np.sqrt(1.0 / mean)), 2.0 * mean**2 / max(spread, 1e-12 * mean**2)
