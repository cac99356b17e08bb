"""Whether residuals follow a pattern: a fit's residuals tested for further unknowns, by one linear step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from workers.judge.topics import LOOK_RATE
from workers.solver.error_model import ErrorModel, unweighed, weighed
from workers.solver.estimate import Estimate
from workers.solver.problem import FitProblem
from workers.solver.shared_errors import shared_errors
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# scipy publishes no types.
_chance_above: Callable[..., Any] = special.fdtrc
# A direction that the fit's own parameters leave less than this share of tells nothing of its own.
_LEAST_SHARE: Final = 0.02


class PatternTest(NamedTuple):
    """The test of further unknowns on the residuals.

    `values` (e,) and their `deviations` (e,), infinite where the fit's own parameters do the same. `probability` of
    such residuals without the unknowns; `evidence`: Wald's statistic less twice the unknowns that are told apart
    (Akaike 1974), to compare rivals by. `pattern` (N, 2), px: by how much the pixels change with the unknowns and
    with the parameters of the fit that change along. `covariance` (e, e) of the values; `parameters` (F, e): how the
    fit's own parameters follow each unknown, rad, m and px.
    """

    values: Floats
    deviations: Floats
    probability: float
    evidence: float
    pattern: Floats
    covariance: Floats
    parameters: Floats


def pattern_test(
    estimate: Estimate, columns: Floats, beside: Floats | None = None, without: str = ""
) -> PatternTest | None:
    """Test unknowns by which the pixels change as `columns` (N, 2, e) say, px per unit of each.

    beside (N, 2, b): such of rivals, which are fitted along. without: a common error that these replace.

    The unknowns and the fit's own parameters are solved for together, linearised at the fit. What stretches of a walk
    share would absorb them. There the pairs count as independent first; what then is beyond chance is tested again
    beside the shared errors, which explain more. None if the result states no errors.
    """
    if estimate.errors is None or estimate.plain is None:
        return None
    problem = whitened(estimate.holding, estimate.held_at)
    rows = weighed(problem, np.nan_to_num(columns))
    plain, errors = (each.without(without) for each in (estimate.plain, estimate.errors))
    own = len(plain.scale)
    if beside is not None and beside.shape[2]:
        plain, errors = (each.with_columns(weighed(problem, np.nan_to_num(beside))) for each in (plain, errors))
    combined = _told_apart(plain, rows)
    if combined.shape[1] == 0:
        nothing = np.zeros(columns.shape[2])
        open_ = np.diag(nothing + np.inf)
        follow = np.zeros((own, columns.shape[2]))
        return PatternTest(nothing, nothing + np.inf, 1.0, 0.0, np.zeros(columns.shape[:2]), open_, follow)
    if problem.blocks is None or not problem.blocks.over_time:
        return _tested(problem, errors.with_columns(rows @ combined), combined, own)
    wider = plain.with_columns(rows @ combined)
    alone = _tested(problem, wider, combined, own)
    if alone.probability >= LOOK_RATE:
        return alone
    shared = shared_errors(problem, estimate.held_at, wider)
    return alone if shared is None else _tested(problem, shared.errors, combined, own)


def _tested(problem: FitProblem, errors: ErrorModel, combined: Floats, own: int) -> PatternTest:
    """The test of the last unknowns of `errors`, of which (e, k) `combined` are made of the columns, beside the fit's
    `own` parameters.
    """
    count = combined.shape[1]
    # The residual is projection minus mark: the pixels move by -step to meet the marks.
    whole = errors.step()
    step, covariance = whole[-count:], errors.covariance()[-count:, -count:]
    statistic = float(step @ np.linalg.pinv(covariance, hermitian=True) @ step) / count
    freedom = min(max(float(np.median(errors.of_pairs().freedoms()[-count:])), 1.0), 1e9)
    values = combined @ step
    of_values = combined @ covariance @ combined.T
    variances = np.diag(of_values)
    # How the fit's own parameters follow an unknown: -(J^T J / sigma^2 + P)^-1 J^T g / sigma^2.
    flat = errors.fit.jacobian.reshape(-1, errors.fit.jacobian.shape[2])
    J, g = flat[:, :own], flat[:, -count:]
    normal = J.T @ J / errors.noise + errors.fit.prior[:own, :own]
    follow = -np.linalg.pinv(normal, rcond=1e-14, hermitian=True) @ (J.T @ g) / errors.noise
    follow = follow * errors.scale[:own, None] / errors.scale[-count:]
    return PatternTest(
        values,
        np.sqrt(np.where(variances > 0.0, variances, np.inf)),
        float(_chance_above(count, freedom, statistic)),
        count * statistic - 2.0 * count,
        unweighed(problem, errors.fit.jacobian @ (whole / errors.scale)),
        of_values,
        follow @ np.linalg.pinv(combined),
    )


def _told_apart(errors: ErrorModel, rows: Floats) -> Floats:
    """(e, k) the combinations of unknowns that the fit's own parameters cannot do."""
    own = errors.fit.jacobian.reshape(-1, len(errors.scale))
    G = rows.reshape(len(own), -1)
    lengths = np.linalg.norm(G, axis=0)
    scale = np.where(lengths > 0.0, 1.0 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    # Priors hold parameters too: they count as rows.
    root = np.linalg.cholesky(errors.fit.prior * errors.noise + 1e-12 * np.eye(len(errors.scale))).T
    basis, sizes, _ = np.linalg.svd(np.concatenate([own, root]), full_matrices=False)
    own_basis = basis[:, sizes > 1e-9 * sizes[0]]
    padded = np.concatenate([G * scale, np.zeros((len(root), G.shape[1]))])
    rest = padded - own_basis @ (own_basis.T @ padded)
    _, left, turn = np.linalg.svd(rest, full_matrices=False)
    return scale[:, None] * turn[left > _LEAST_SHARE].T
