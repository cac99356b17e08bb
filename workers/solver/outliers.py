"""Names outliers, the pairs that the fit of the others rejects, with their distance and direction."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf, log, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.results import Outlier
from workers.solver.polish import (
    Fit,
    distances,
    polish,
    refine,
    robust_sigma_px,
    standard_distances,
    weighted_residuals,
)
from workers.solver.problem import FitProblem
from workers.solver.residuals import predict
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
FALSE_ALARMS: Final = 0.01
"""Chance that Gaussian marks without any outlier get one named, per fit."""
_ROUNDS: Final = 5


def threshold_of(pairs: int) -> float:
    """Distance in sigmas that marks in the plane exceed once in pairs / FALSE_ALARMS (Rayleigh, Bonferroni)."""
    return sqrt(2.0 * log(max(pairs, 1) / FALSE_ALARMS))


def without(problem: FitProblem, outliers: Sequence[Outlier]) -> FitProblem:
    """The problem with those pairs at weight 0."""
    weights = problem.weights.copy()
    weights[[outlier.index for outlier in outliers]] = 0.0
    return replace(problem, weights=weights)


class Judged(NamedTuple):
    """The pairs that the fit of the others rejects, the worst first, and that fit, by least squares."""

    outliers: list[Outlier]
    fit: Fit


def judge(problem: FitProblem, start: Floats, robust_fit: Fit | None = None) -> Judged:
    """The pairs that the fit of the others rejects.

    start (D,): any fit of these pairs. A robust fit from there, if none is at hand, finds the clear ones; then the
    rest is fitted by least squares and all pairs are judged again, until the same ones stand out twice. A pair's
    distance counts in standard deviations of its own residual: one that alone holds a parameter has little of that
    (leverage), and one left out has more.
    """
    # Only a saturating loss names a distance past which pairs are wrong; otherwise the median alone judges.
    saturation = problem.saturation_px if problem.loss == "saturating" else inf
    saturating = replace(problem, loss="saturating", saturation_px=saturation)
    fit = robust_fit or polish(saturating, start)
    robust = np.array(fit.parameters)
    here = whitened(saturating, robust)
    sigma = robust_sigma_px(here, robust)
    scores = np.where(problem.weights > 0.0, standard_distances(here, robust) / sigma, 0.0)
    limit = threshold_of(int(np.count_nonzero(problem.weights)))
    out, p = scores > limit, robust
    plain = replace(problem, loss="mean", saturation_px=inf)
    for _ in range(_ROUNDS):
        weights = np.where(out, 0.0, problem.weights)
        if np.count_nonzero(weights) < max(len(problem.free), 1):
            return Judged([], polish(plain, robust))
        fit = refine(replace(plain, weights=weights), p)
        p = np.array(fit.parameters)
        here = whitened(plain, p)
        scores = _scores(here, replace(here, weights=weights), p)
        again = scores > limit
        if np.array_equal(again, out):
            break
        out = again
    else:
        fit = refine(replace(plain, weights=np.where(out, 0.0, problem.weights)), p)
    order = np.flatnonzero(out)[np.argsort(-scores[out], kind="stable")]
    d = distances(problem, p)
    pixels, violation = predict(problem, p)
    outliers = [
        Outlier(
            index=i,
            residual_px=float(d[i]),
            score=float(scores[i]),
            reason=_reason(problem, pixels, violation, i, float(scores[i]), sigma),
            excluded=problem.outliers == "exclude",
        )
        for i in order.tolist()
    ]
    return Judged(outliers, fit)


def _scores(problem: FitProblem, reduced: FitProblem, p: Floats) -> Floats:
    # Studentised distances (N,). With G the fit's covariance over sigma^2 and J_i a pair's rows, its residual's
    # covariance is I - J_i G J_i^T where the pair was fitted, and I + J_i G J_i^T where it was left out.
    residuals, J = weighted_residuals(problem, p)
    n = len(problem.points)
    taken = leverage(weighted_residuals(reduced, p)[1], J[: 2 * n].reshape(n, 2, -1))
    sign = np.where(reduced.weights > 0.0, -1.0, 1.0)[:, None, None]
    covariance = np.eye(2) + sign * taken
    # A pair that the fit follows wherever its mark lies cannot be judged: its share is floored, not divided by zero.
    values, vectors = np.linalg.eigh(covariance)
    along = np.einsum("nji,nj->ni", vectors, residuals[: 2 * n].reshape(n, 2))
    squares = np.sum(along**2 / np.maximum(values, 0.05), axis=1)
    sigma = robust_sigma_px(reduced, p)
    return np.where(problem.weights > 0.0, np.sqrt(squares) / sigma, 0.0)


def leverage(fitted: Floats, blocks: Floats) -> Floats:
    """J_i (J^T J)^-1 J_i^T (N, 2, 2) of pairs' rows J_i (N, 2, F) under the rows J (M, F) that were fitted.

    Columns count at equal length: pixels for a radian and for a distortion term differ by powers of ten, and a
    direction that only such a term holds would pass for none.
    """
    lengths: Floats = np.sqrt(np.sum(fitted**2, axis=0))
    lengths[lengths == 0.0] = 1.0
    unit, scaled = fitted / lengths, blocks / lengths
    G = np.linalg.pinv(unit.T @ unit, rcond=1e-12, hermitian=True)
    return np.einsum("nif,fg,njg->nij", scaled, G, scaled)


def _reason(problem: FitProblem, pixels: Floats, violation: Floats, i: int, score: float, sigma: float) -> str:
    problem.stop.check()
    if violation[i] > 0.0:
        return "Its point lies behind the camera or past the range of the lens model."
    off = problem.pixels[i] - pixels[i]
    words = (
        f"The mark lies {abs(off[0]):.1f} px {'right' if off[0] > 0 else 'left'} and {abs(off[1]):.1f} px "
        f"{'below' if off[1] > 0 else 'above'} of where the corner projects, {score:.1f} standard deviations"
    )
    gaps = np.hypot(*(pixels - problem.pixels[i]).T)
    gaps[violation > 0.0] = np.inf
    gaps[i] = np.inf
    nearest = int(np.argmin(gaps))
    if gaps[nearest] < 3.0 * sigma:
        back = np.hypot(*(problem.pixels[nearest] - pixels[i]))
        if back < 3.0 * sigma:
            return f"{words}: it and the mark of pair {nearest} look swapped."
        return f"{words}: it lies where the corner of pair {nearest} projects."
    return f"{words}."
