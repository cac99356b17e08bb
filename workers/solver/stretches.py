"""What stretches of a walk share, if the pairs come in groups: the corners of a sweep err together, too.

A group lies whole in one stretch. The errors of its pairs are noise, what the group shares, and a shift of the marks
of its stretch. First the groups' variances are estimated with every stretch's shift unknown, so that shifts do not
count as errors of groups. Then the pairs are whitened by these variances, group by group, and the variance of the
shifts is estimated from them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workers.solver.error_model import ErrorModel
from workers.solver.variance_components import (
    Components,
    Linearised,
    Variances,
    likelihood_ratio,
    uncertainty_of,
    variances_of,
)

Floats = NDArray[np.float64]
_NOTHING = 1e-12  # of an eigenvalue: in this direction a group shares nothing


def with_stretches(model: ErrorModel, groups: Components, shifts: Components) -> tuple[float, ErrorModel]:
    """The model of errors with what groups and stretches share.

    model: without what blocks share. groups: as the pairs name them. shifts: of the stretches' marks. Returns twice
    the log likelihood ratio to errors that only groups share, and the model; its last variance is that of the shifts.
    """
    within = variances_of(model.with_columns(_of_each(shifts)).fit, groups)
    whitened = _whitener(groups, within)
    fit = Linearised(
        whitened(model.fit.residuals[:, :, None])[:, :, 0],
        whitened(model.fit.jacobian),
        model.fit.prior,
        model.fit.pull,
    )
    alike = replace(shifts, shapes=whitened(shifts.shapes))
    fitted = variances_of(fit, alike)
    noise, shift = fitted.variances.tolist()
    of_groups = within.variances[1:] * noise / within.variances[0]
    unsure = np.zeros((2 + len(of_groups), 2 + len(of_groups)))
    unsure[:-1, :-1], unsure[-1, -1] = uncertainty_of(within), uncertainty_of(fitted)[1, 1]
    both = replace(model, noise=noise, shared=(groups, shifts), variances=np.append(of_groups, shift), unsure=unsure)
    return likelihood_ratio(fit, alike, fitted), both


def _of_each(shifts: Components) -> Floats:
    """(N, 2, 2 S) derivatives by the shifts of each of S stretches."""
    count = int(shifts.labels.max()) + 1
    mine = shifts.labels[:, None] == np.arange(count)
    return (shifts.shapes[:, :, None, :] * mine[:, None, :, None]).reshape(*shifts.shapes.shape[:2], -1)


def _whitener(groups: Components, variances: Variances) -> Callable[[Floats], Floats]:
    """(N, 2, m) -> the same times (1 + A A^T)^(-1/2) of each group, A being what it shares over the noise.

    With A^T A = W L W^T that is 1 + A W ((1 + L)^(-1/2) - 1) L^-1 W^T A^T.
    """
    root = np.sqrt(variances.variances[1:][groups.component] / variances.variances[0])
    A, count = groups.shapes * root, int(groups.labels.max()) + 1

    def by_group(values: Floats) -> Floats:
        total = np.zeros((count, *values.shape[1:]))
        np.add.at(total, groups.labels, values)
        return total

    values, W = np.linalg.eigh(by_group(np.einsum("nci,ncj->nij", A, A)))
    some = np.maximum(values, _NOTHING)
    gain = (1.0 / np.sqrt(1.0 + some) - 1.0) / some
    inner = np.einsum("gij,gj,gkj->gik", W, gain, W)

    def whitened(rows: Floats) -> Floats:
        shared = inner @ by_group(np.einsum("nci,ncm->nim", A, rows))
        return rows + np.einsum("nci,nim->ncm", A, shared[groups.labels])

    return whitened
