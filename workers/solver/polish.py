# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
"""The last step: least squares from where the search ended, and the plain baseline beside it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from workers.geometry.projection import distances_px
from workers.solver.problem import FitProblem
from workers.solver.residuals import predict, residuals_and_jacobian

Floats = NDArray[np.float64]
# scipy publishes no types.
_least_squares: Callable[..., Any] = optimize.least_squares
SQUARES: Final = "sum of squared pixel distances"
ROBUST: Final = "Cauchy loss of pixel distances"
MAX_EVALUATIONS: Final = 300


@dataclass(frozen=True)
class Fit:
    """Parameters (D,) in the order of `problem.names`; mean and RMS distance in px; what was minimised.

    `converged` is false where the iterations ran out; `message` is the solver's own sentence.
    """

    parameters: tuple[float, ...]
    mean_px: float
    rms_px: float
    minimised: str
    converged: bool
    message: str
    evaluations: int


def polish(problem: FitProblem, start: Sequence[float] | Floats, walls: bool = True) -> Fit:
    """Least squares over the free parameters inside the problem's bounds, from `start` (D,).

    Trust region reflective (scipy.optimize.least_squares) with analytic derivatives. It minimises the weighted
    squared pixel distances plus the priors; where the problem's loss is `saturating`, a Cauchy loss of the same
    residuals, its scale taken from the residuals at the start. `walls`: as in `residuals_and_jacobian`.
    """
    p = np.clip(np.asarray(start, dtype=np.float64), problem.lower, problem.upper)
    free = problem.free
    if len(free) == 0:
        return _fit(problem, p, SQUARES, True, "Nothing is free to move.", 0)
    lower, upper = problem.lower[free], problem.upper[free]
    # The solver wants a start strictly inside.
    margin = 1e-9 * (upper - lower)
    robust = problem.loss == "saturating"

    def full(x: Floats) -> Floats:
        q = p.copy()
        q[free] = x
        return q

    def residuals(x: Floats) -> Floats:
        return weighted_residuals(problem, full(x), walls=walls)[0]

    def jacobian(x: Floats) -> Floats:
        return weighted_residuals(problem, full(x), walls=walls)[1]

    found = _least_squares(
        residuals,
        np.clip(p[free], lower + margin, upper - margin),
        jac=jacobian,
        bounds=(lower, upper),
        method="trf",
        x_scale="jac",
        ftol=1e-12,
        xtol=1e-12,
        gtol=1e-12,
        max_nfev=MAX_EVALUATIONS,
        loss="cauchy" if robust else "linear",
        f_scale=_robust_scale(problem, p) if robust else 1.0,
    )
    return _fit(
        problem, full(found.x), ROBUST if robust else SQUARES, found.status > 0, found.message, int(found.nfev)
    )


def baseline(problem: FitProblem) -> Fit:
    """The plain baseline: least squares from the centre of the bounds, with no search before it.

    It first runs over the continued formulas, in which forbidden projections are no walls (from a far start walls
    would stop it at once), and then once more with them, from wherever it came to.
    """
    return polish(problem, polish(problem, 0.5 * (problem.lower + problem.upper), walls=False).parameters)


def distances(problem: FitProblem, p: Sequence[float] | Floats) -> Floats:
    """Distance (N,) in px of every pair under parameters (D,); a forbidden projection counts its cost."""
    pixels, violation = predict(problem, np.asarray(p, dtype=np.float64))
    return distances_px(pixels, violation, problem.pixels, problem.diagonal_px)


def mean_and_rms(problem: FitProblem, p: Sequence[float] | Floats) -> tuple[float, float]:
    """Weighted mean and root mean square of `distances`, in px."""
    d = distances(problem, p)
    total = float(np.sum(problem.weights))
    return float(np.sum(problem.weights * d)) / total, sqrt(float(np.sum(problem.weights * d * d)) / total)


def weighted_residuals(
    problem: FitProblem, p: Floats, local: bool = False, walls: bool = True
) -> tuple[Floats, Floats]:
    """Residuals and their Jacobian in the free parameters, rows weighted, one row more for each prior.

    Shapes (2 N + priors,) and (2 N + priors, free). The unit is the pixel: a prior's row is its standard score
    times the marks' sigma.
    """
    residuals, jacobian = residuals_and_jacobian(problem, p, local, walls)
    root = np.sqrt(np.repeat(problem.weights, 2))
    rows, derivatives = [root * residuals], [root[:, None] * jacobian]
    for name, (mean, sigma) in problem.priors.items():
        index = problem.names.index(name)
        strength = problem.mark_sigma_px / sigma
        row = np.zeros((1, len(p)))
        row[0, index] = strength
        rows.append(np.array([strength * (p[index] - mean)]))
        derivatives.append(row)
    return np.concatenate(rows), np.ascontiguousarray(np.concatenate(derivatives)[:, problem.free])


def _robust_scale(problem: FitProblem, p: Floats) -> float:
    # 1.18 is the median distance of unit Gaussian marks in the plane; a tenth of a pixel is as good as marks get.
    return max(0.1, 2.0 * float(np.median(distances(problem, p)[problem.weights > 0.0])) / 1.18)


def _fit(problem: FitProblem, p: Floats, minimised: str, converged: bool, message: str, evaluations: int) -> Fit:
    mean, rms = mean_and_rms(problem, p)
    return Fit(tuple(p.tolist()), mean, rms, minimised, bool(converged), message, evaluations)
