"""Errors over Cramer-Rao sigmas, and whether the reported intervals hold them."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.rotations import rotation_from_vector, vector_from_rotation
from benchmarks.accuracy.rigs import Rig
from workers.solver.estimate import Estimate, estimate
from workers.solver.polish import Fit, weighted_residuals
from workers.solver.problem import FitProblem
from workers.solver.residuals import predict

Floats = NDArray[np.float64]
DRAWS = 8
"""Draws of the marks' noise per rig: a rig's parameters err together, so that one draw of each tells little."""
INSIDE_SIGMAS = 4.0


def error_bars(rig: Rig, problem: FitProblem, found: Estimate, rng: np.random.Generator) -> dict[str, Any]:
    """Of the marks that were searched, whose estimate is given, and of fresh ones of 1 px, fitted from the truth."""
    sigma = crb_sigma(problem, rig.truth)
    exact = predict(problem, rig.truth)[0]
    scores, held = [_squares(rig, found.fit, sigma)], [_held(rig, found)]
    for _ in range(DRAWS - 1):
        again = replace(problem, pixels=exact + rng.normal(size=exact.shape))
        refitted = estimate(again, rig.truth)
        scores.append(_squares(rig, refitted.fit, sigma))
        held.append(_held(rig, refitted))
    return {
        "inside": _inside(problem, rig.truth, sigma),
        "squared_scores": scores,
        "held": held,
    }


def crb_sigma(problem: FitProblem, truth: Floats) -> Floats:
    """Cramer-Rao sigmas (D,) at the truth, of marks of `mark_sigma_px`."""
    J = weighted_residuals(problem, truth, local=False)[1] / problem.mark_sigma_px
    return np.sqrt(np.diag(np.linalg.inv(J.T @ J)))


def root_mean_square(scores: list[Any], seed: int) -> tuple[float, float]:
    """Of nested scores, a list for each rig; and its standard error by bootstrap over the rigs."""
    means = np.array([np.mean(one) for one in scores])
    rng = np.random.default_rng(seed)
    drawn = means[rng.integers(len(means), size=(1000, len(means)))].mean(axis=1)
    return float(np.sqrt(means.mean())), float(np.std(np.sqrt(drawn)))


def _squares(rig: Rig, fit: Fit, sigma: Floats) -> list[float]:
    return (((np.array(fit.parameters) - rig.truth) / sigma) ** 2).tolist()


def _held(rig: Rig, found: Estimate) -> list[bool]:
    # The reported rotations are small turns about the camera's axes.
    p = found.parameters
    turn = rotation_from_vector(p[:3]) @ rotation_from_vector(rig.truth[:3]).T
    error = np.concatenate([np.degrees(vector_from_rotation(turn)), (p - rig.truth)[3:]])
    return (np.abs(error) <= found.spread.half_width95).tolist()


def _inside(problem: FitProblem, truth: Floats, sigma: Floats) -> bool:
    room = np.minimum(truth - problem.lower, problem.upper - truth)
    return bool((room > INSIDE_SIGMAS * sigma).all())
