# pyright: reportMissingTypeStubs=false
"""Evaluations until a slot is within 1 % of the optimum, and the optimum by another library."""

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from benchmarks.solver.contest import GENERATIONS
from workers.geometry.projection import project
from workers.solver.polish import polish
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.slot import run_slot

Floats = NDArray[np.float64]
WITHIN: Final = 1.01
# Added under the root of a distance, px^2: it has no derivative at zero.
_ROUND: Final = 1e-9


@dataclass(frozen=True)
class Optimum:
    """The least mean distance in px by SciPy, and the RMS of our polish over that of SciPy's least squares."""

    mean_px: float
    rms_of_polish: float


def optimum(problem: FitProblem, near: Floats) -> Optimum:
    """From the parameters (D,) that made the marks: SciPy's trust region method and differences, none of our solver.

    It stays inside the problem's bounds, as every search does. The mean distance is the sum of squares of the
    distances' roots.
    """
    scale = np.maximum(np.abs(near), 1e-2)
    lower, upper = problem.lower, problem.upper
    if problem.any_rotation:
        lower[:3], upper[:3] = -np.inf, np.inf

    def apart(x: Floats) -> Floats:
        p = x * scale
        return project(problem.model, p[6:], transform_of(problem, p).apply(problem.points))[0] - problem.pixels

    def roots(x: Floats) -> Floats:
        return (np.sum(apart(x) ** 2, axis=1) + _ROUND) ** 0.25

    tight: dict[str, Any] = {"ftol": 1e-12, "xtol": 1e-12, "gtol": 1e-12, "x_scale": "jac", "max_nfev": 400}
    tight["bounds"] = (lower / scale, upper / scale)
    squares = optimize.least_squares(lambda x: apart(x).ravel(), near / scale, **tight)
    mean = optimize.least_squares(roots, squares.x, **tight)
    rms = float(np.sqrt(2.0 * squares.cost / len(problem.points)))
    return Optimum(2.0 * float(mean.cost) / len(problem.points), polish(problem, near).rms_px / rms)


def evaluations_of_slot_to(target_px: float, problem: FitProblem) -> int | None:
    """Fewer generations are the beginning of more, so their least number is found by halving."""
    low, high = problem.lower.tolist(), problem.upper.tolist()

    def after(generations: int) -> tuple[float, int]:
        shorter = replace(problem, schedule=replace(problem.schedule, generations=generations))
        outcome = run_slot(shorter, low, high, 0, 0)
        return outcome.loss, outcome.evaluations

    if after(GENERATIONS)[0] > target_px:
        return None
    least, most = 1, GENERATIONS
    while least < most:
        middle = (least + most) // 2
        least, most = (least, middle) if after(middle)[0] <= target_px else (middle + 1, most)
    return after(most)[1]
