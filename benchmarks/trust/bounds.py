"""How often the best test could notice a fault from the pairs."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.stats import norm

from benchmarks.trust.judging import Judged
from workers.judge.residual_patterns import pattern_test
from workers.judge.time_checks import image_velocities
from workers.reports.material import FittedModel
from workers.solver.error_model import weighed
from workers.solver.estimate import Estimate, estimate
from workers.solver.residuals import by_point
from workers.solver.weighting import whitened

_ACCUSED: Final = 1.0 / 40.0


def shutter_power(found: Judged, line_time_us: float, *, offset_known: bool) -> float:
    """The share of draws of the marks' noise in which a line time would be noticed, from the stated covariance.

    The power of a two-sided test that accuses one of 200 cameras without it (decision 0052), linearised at the fit.
    ``offset_known``: the clocks' offset is not one more unknown.
    """
    ended = _estimate_of(found.fitted)
    moved = image_velocities(ended)
    late = 1e-6 * ended.holding.rows_below[:, None] * moved
    result = pattern_test(ended, late[:, :, None] if offset_known else np.stack([late, moved], axis=2))
    if result is None:
        return 0.0
    shift = line_time_us / result.deviations[0]
    limit = norm.isf(0.0025)
    return float(norm.sf(limit - shift) + norm.cdf(-limit - shift))


def poses_power(found: Judged, pose_m: float, draws: int = 20_000) -> float:
    """The share of draws in which offsets of poses, of this deviation along each axis, would be noticed.

    The power of the most powerful test (Neyman and Pearson 1933), which knows the offsets' deviation and the marks'
    noise, among those that accuse one of 40 sound results, as the solver's alarm does. Linearised at the fit.
    """
    ended = _estimate_of(found.fitted)
    if ended.plain is None or ended.holding.blocks is None:
        return 0.0
    problem = whitened(ended.holding, ended.held_at)
    used = problem.weights > 0.0
    rows = weighed(problem, by_point(problem, ended.held_at))[used]
    pose = np.asarray(ended.holding.blocks.labels)[used]
    shared = np.zeros((len(rows), 2, int(pose.max()) + 1, 3))
    shared[np.arange(len(rows)), :, pose] = rows
    own = ended.plain.fit.jacobian[used].reshape(2 * len(rows), -1)
    basis = np.linalg.qr(own)[0]
    B = pose_m * shared.reshape(2 * len(rows), -1)
    B -= basis @ (basis.T @ B)
    # Variances that the offsets add along each direction of the residuals, in those of the noise.
    added = np.linalg.svd(B, compute_uv=False) ** 2 / ended.plain.noise
    squares = np.random.default_rng(1).normal(size=(draws, len(added))) ** 2
    weights = added / (1.0 + added)
    limit = np.quantile(squares @ weights, 1.0 - _ACCUSED)
    return float(np.mean(squares @ added > limit))


def _estimate_of(model: FittedModel) -> Estimate:
    problem, parameters = replace(model.problem, outliers="exclude"), model.document["polished"]["parameters"]
    return estimate(problem, np.array([parameters[name] for name in problem.names]))
