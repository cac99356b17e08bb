"""Whether residuals follow a pattern: a fit's residuals tested for further unknowns, by one linear step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from workers.solver.error_model import ErrorModel, weighed
from workers.solver.estimate import Estimate
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# scipy publishes no types.
_chance_above: Callable[..., Any] = special.fdtrc
# A direction that the fit's own parameters leave less than this share of tells nothing of its own.
_LEAST_SHARE: Final = 0.02


class Tested(NamedTuple):
    """What the residuals say of further unknowns.

    ``values`` (e,) and their ``deviations`` (e,); infinite where the fit's own parameters do the same.
    ``probability`` of such residuals without them. ``pattern`` (N, 2): the residuals that they explain, px.
    """

    values: Floats
    deviations: Floats
    probability: float
    pattern: Floats


def tested(found: Estimate, columns: Floats) -> Tested | None:
    """Test unknowns by which the pixels change as ``columns`` (N, 2, e) say, per unit of each.

    The unknowns and the fit's own parameters are solved for together, linearised at the fit; errors are those that
    the result states. A walk's stretches may absorb the pattern as shared errors, so there the pairs count as
    independent, as in the test of halves for a turn. None if the result states no errors.
    """
    if found.errors is None:
        return None
    blocks = found.holding.blocks
    is_posed = blocks is not None and blocks.kind == "group"
    errors = found.errors if is_posed or found.plain is None else found.plain
    here = whitened(found.holding, found.held_at)
    rows = weighed(here, np.nan_to_num(columns))
    combined = _told_apart(errors, rows)
    if combined.shape[1] == 0:
        count = columns.shape[2]
        return Tested(np.zeros(count), np.full(count, np.inf), 1.0, np.zeros(columns.shape[:2]))
    wider = errors.with_columns(rows @ combined)
    more = combined.shape[1]
    # The residual is projection minus mark: the pixels move by -step to meet the marks.
    step, covariance = wider.step()[-more:], wider.covariance()[-more:, -more:]
    statistic = float(step @ np.linalg.pinv(covariance, hermitian=True) @ step) / more
    freedom = min(float(np.median(wider.of_pairs().freedoms()[-more:])), 1e9)
    values = combined @ step
    variances = np.einsum("ei,ij,ej->e", combined, covariance, combined)
    lost = ~(variances > 0.0)
    return Tested(
        values,
        np.sqrt(np.where(lost, np.inf, variances)),
        float(_chance_above(more, freedom, statistic)),
        np.einsum("nce,e->nc", np.nan_to_num(columns), values),
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
    kept = basis[:, sizes > 1e-9 * sizes[0]]
    padded = np.concatenate([G * scale, np.zeros((len(root), G.shape[1]))])
    rest = padded - kept @ (kept.T @ padded)
    _, left, turn = np.linalg.svd(rest, full_matrices=False)
    return scale[:, None] * turn[left > _LEAST_SHARE].T
