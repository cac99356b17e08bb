# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
"""Newton's steps near a minimum of squares or of a robust loss."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
import scipy  # its subpackages are loaded by their first use
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_MOST_STEPS: Final = 20
_LEAST_DAMPING: Final = 1e-3
_DAMPED: Final = 10.0
_ROUNDING: Final = 1e-14
"""Share of the cost: a step that gains no more ends at the minimum, as far as rounded sums tell it."""


class Quadratic(NamedTuple):
    """The minimised function about a point, px^2: its value, half of its gradient (F,) and of its Hessian (F, F)."""

    value: float
    slope: Floats
    curvature: Floats


def newton(
    about: Callable[[Floats], Quadratic], start: Floats, lower: Floats, upper: Floats, most: int
) -> Floats | None:
    """Return the minimum near `start` (F,) within bounds (F,), by Newton's steps; None if they do not end.

    Steps stop at the bounds, and parameters that a bound holds stay there (Bertsekas 1982). A step that would raise
    the value, or that is not unique, is damped (Levenberg 1944, Marquardt 1963). It does not end if residuals are so
    large that their own curvature counts. Then a trust region has to find the way, by steps that cost three times as
    much, and under a robust loss by many more.
    """
    x, here, damping = start, about(start), 0.0
    for _ in range(min(_MOST_STEPS, most)):
        inside = ~(((x <= lower) & (here.slope > 0.0)) | ((x >= upper) & (here.slope < 0.0)))
        curvature, slope = here.curvature[np.ix_(inside, inside)], here.slope[inside]
        unit = np.sqrt(np.abs(np.diag(curvature)))
        if not (unit.all() and np.isfinite(here.value)):
            return None
        try:
            damped = curvature / unit / unit[:, None] + damping * np.eye(len(unit))
            factor = scipy.linalg.cho_factor(damped, check_finite=False)
        except np.linalg.LinAlgError:
            damping = max(_DAMPED * damping, _LEAST_DAMPING)
            continue
        step = scipy.linalg.cho_solve(factor, slope / unit, check_finite=False) / unit
        to = x.copy()
        to[inside] -= step
        to = np.clip(to, lower, upper)
        if damping <= _LEAST_DAMPING and float(step @ slope) <= _ROUNDING * here.value:
            return to
        there = about(to)
        if there.value <= here.value * (1.0 + _ROUNDING):
            x, here, damping = to, there, damping / _DAMPED if damping > _LEAST_DAMPING else 0.0
        else:
            damping = max(_DAMPED * damping, _LEAST_DAMPING)
    return None


def quadratic(residuals: Floats, jacobian: Floats, count: int, scale: float | None) -> Quadratic:
    """Return squares, or the loss of `saturated`, of residuals (M,) about where their Jacobian is (M, F).

    The residuals' own curvature is left out (Gauss and Newton), that of the loss is exact: with w = r / c and
    q = 1 / (1 + w^2) a pair's rows weigh q^2, less 4 q^3 along w.
    """
    if scale is None:
        return Quadratic(float(residuals @ residuals), jacobian.T @ residuals, jacobian.T @ jacobian)
    pairs, blocks = residuals[:count].reshape(-1, 2) / scale, jacobian[:count].reshape(count // 2, 2, -1)
    square = np.sum(pairs * pairs, axis=1)
    q = 1.0 / (1.0 + square)
    weighed = (q**2)[:, None, None] * blocks
    along = 2.0 * (q**1.5)[:, None] * np.einsum("nc,ncf->nf", pairs, blocks)
    rest, of_rest = residuals[count:], jacobian[count:]
    flat = weighed.reshape(count, -1)
    return Quadratic(
        scale**2 * float(square @ q) + float(rest @ rest),
        flat.T @ residuals[:count] + of_rest.T @ rest,
        flat.T @ jacobian[:count] - along.T @ along + of_rest.T @ of_rest,
    )


def saturated(residuals: Floats, jacobian: Floats | None, count: int, scale: float) -> tuple[Floats, Floats]:
    """Return residuals (M,) and Jacobian (M, F) whose squares sum to the loss of Geman and McClure (1987).

    Of the first `count` rows, each pair's two residuals r become r / sqrt(1 + |r|^2 / c^2) with c = `scale`, px.
    """
    pairs = residuals[:count].reshape(-1, 2)
    root = 1.0 / np.sqrt(1.0 + np.sum(pairs * pairs, axis=1) / scale**2)
    bent = residuals.copy()
    bent[:count] = (root[:, None] * pairs).ravel()
    if jacobian is None:
        return bent, np.empty((0, 0))
    blocks = jacobian[:count].reshape(len(pairs), 2, -1)
    along = np.einsum("nc,ncf->nf", pairs, blocks)
    turned = jacobian.copy()
    turned[:count] = (
        root[:, None, None] * blocks - (root**3 / scale**2)[:, None, None] * pairs[:, :, None] * along[:, None, :]
    ).reshape(count, -1)
    return bent, turned
