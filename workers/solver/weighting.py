"""Stated covariances as weights: scalars for the search, whitened residuals for everything after it.

The errors of a pair in the image are C = C_mark + J C_point J^T (2, 2), px^2, with J (2, 3) the projection's
derivative by the LiDAR point. Both forms of weight are relative to a typical pair (the median sqrt(trace C / 2)), so
that residuals stay in pixels: a typical pair's are as they are, a better one's count more.
"""

from copy import copy
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.covariances import Covariances
from workers.solver.problem import FitProblem
from workers.solver.residuals import by_point, predict

Floats = NDArray[np.float64]
REWEIGHTED: Final = 2
"""How often J is found anew after a fit: it depends weakly on the parameters, and the second time changes little."""


def search_weights(problem: FitProblem) -> tuple[Floats, float]:
    """Weights (N,) of the pairs' distances in the search, and the typical noise in px that they are relative to.

    1 / sigma, since the loss is a distance. They hold for any individual and any mount: the vertex's errors across
    its ray count as an angle under the middle of the focal lengths' bounds. Without covariances the problem's own.
    """
    if problem.covariances is None:
        return problem.weights, problem.mark_sigma_px
    variance = _rough_variance(problem, problem.covariances)
    typical = float(np.sqrt(np.median(variance[problem.weights > 0.0])))
    return problem.weights * typical / np.sqrt(variance), typical


def roughly_whitened(problem: FitProblem) -> FitProblem:
    """`whitened` before any parameters are known: by the variances that the search goes by."""
    if problem.covariances is None:
        return problem
    variance = _rough_variance(problem, problem.covariances)
    return _with(problem, variance[:, None, None] * np.eye(2))


def whitened(problem: FitProblem, p: Floats) -> FitProblem:
    """The problem with its residuals whitened by the pairs' covariances as they are at p (D,).

    `whitening` (N, 2, 2) is then s L^-1 with C = L L^T, and `mark_sigma_px` is s, the typical noise in px. A
    problem without covariances comes back as it is.
    """
    if problem.covariances is None:
        return problem
    moved = by_point(problem, p)
    C = problem.covariances.marks + np.einsum("nij,njk,nlk->nil", moved, problem.covariances.points, moved)
    lost = (predict(problem, p)[1] > 0.0) | ~np.isfinite(C).all(axis=(1, 2))
    rough = _rough_variance(problem, problem.covariances)
    return _with(problem, np.where(lost[:, None, None], rough[:, None, None] * np.eye(2), C))


def _with(problem: FitProblem, C: Floats) -> FitProblem:
    used = problem.weights > 0.0
    typical = float(np.sqrt(np.median(np.trace(C[used], axis1=1, axis2=2)) / 2.0))
    # A copy, because a new problem would check its pairs and bounds once more.
    here = copy(problem)
    object.__setattr__(here, "whitening", typical * np.linalg.inv(np.linalg.cholesky(C)))
    object.__setattr__(here, "mark_sigma_px", typical)
    return here


def _rough_variance(problem: FitProblem, covariances: Covariances) -> Floats:
    # Per coordinate, px^2 (N,). A range's error lies along the ray and hardly moves the image.
    lower, upper = problem.lower[6:8], problem.upper[6:8]
    focal = np.where(lower > 0.0, np.sqrt(np.maximum(lower, 0.0) * np.maximum(upper, 0.0)), 0.5 * (lower + upper))
    x, S = problem.points, covariances.points
    square = np.maximum(np.sum(x * x, axis=1), 1e-12)
    along = np.einsum("ni,nij,nj->n", x, S, x) / square
    across = np.maximum(S[:, 0, 0] + S[:, 1, 1] + S[:, 2, 2] - along, 0.0) / square
    marks = 0.5 * (covariances.marks[:, 0, 0] + covariances.marks[:, 1, 1])
    return marks + 0.5 * float(np.mean(focal * focal)) * across
