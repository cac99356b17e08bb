"""The biases of the people who marked: what all marks of one person share.

All marks of a person are off by the same shift. The pairs cannot tell the mean shift of all people from the mount.
But if several people marked, their shifts differ, and the differences tell how large shifts are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.pairs import MARKED_BY
from apexcal.documents.precision import PersonBias
from workers.solver.error_model import ErrorModel, weighed
from workers.solver.problem import FitProblem

Floats = NDArray[np.float64]
STATED_FREEDOM: Final = 4.5
"""Degrees of freedom of a deviation that is known to a third: 1 / (2 (1/3)^2) (JCGM 100:2008, equation G.3)."""
_LEAST_PAIRS: Final = 5.0  # fewer whole pairs of one person tell nothing of the shift
_GRID: Final = np.linspace(-6.0, 8.0, 281)  # ln of the variance over the stated one


def shares_of(pairs: Mapping[str, Sequence[Any]]) -> Floats | None:
    """(N, P) share of each person in a set's pairs (columns); rows add up to 1. None where the pairs do not say."""
    markers = pairs.get(MARKED_BY)
    if markers is None:
        return None
    shares = np.zeros((len(markers), 1 + max((max(people) for people in markers if people), default=0)))
    for row, people in enumerate(markers):
        shares[row, people] = 1.0 / max(len(people), 1)
    return shares


def columns_of(problem: FitProblem, shares: Floats) -> Floats:
    """(N, 2, 2 P) derivative of a whitened problem's residuals by each person's shift along u and v."""
    n, people = shares.shape
    columns = np.zeros((n, 2, people, 2))
    columns[:, 0, :, 0] = columns[:, 1, :, 1] = -shares
    return weighed(problem, columns.reshape(n, 2, 2 * people))


def with_people(problem: FitProblem, errors: ErrorModel) -> tuple[ErrorModel, PersonBias | None]:
    """A whitened problem's errors (independent ones, and common ones) with the people's shifts, and these.

    The stated variance is the scale of an inverse chi-square of STATED_FREEDOM degrees of freedom, to which the
    likelihood of the differences between people is joined. Nothing is added if the problem states none.
    """
    stated_px = problem.common_errors.get("person_px", 0.0)
    if stated_px == 0.0:
        return errors, None
    shares = problem.people if problem.people is not None else np.ones((len(problem.points), 1))
    columns = columns_of(problem, shares)
    people = np.flatnonzero(np.sum(shares[problem.weights > 0.0], axis=0) >= _LEAST_PAIRS)
    px, freedom = stated_px, STATED_FREEDOM
    if len(people) > 1:
        px, freedom = _joined(*_differences(errors.of_pairs(), columns, people), stated_px)
    bias = PersonBias(px=px, freedom=freedom, people=shares.shape[1])
    both = np.concatenate([errors.common, bias.px * columns], axis=2)
    terms = errors.terms + ("person_px",) * columns.shape[2]
    estimated = columns.shape[2]
    return replace(errors, common=both, terms=terms, estimated=estimated, common_freedom=bias.freedom), bias


def _differences(errors: ErrorModel, columns: Floats, chosen: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Contrasts (2 (P - 1),) between the shifts of the people, of unit variance where shifts have it, and the
    covariance of their errors.
    """
    people = len(chosen)
    # Rows of an orthonormal basis of all vectors whose members add up to zero.
    contrasts = np.linalg.svd(np.eye(people) - 1.0 / people)[2][:-1]
    n = len(columns)
    of_people = columns.reshape(n, 2, -1, 2)[:, :, chosen]
    along = np.einsum("ncpa,kp->ncka", of_people, contrasts).reshape(n, 2, -1)
    wider = errors.with_columns(along)
    more = along.shape[2]
    return wider.step()[-more:], wider.covariance()[-more:, -more:]


def _joined(differences: Floats, covariance: Floats, stated_px: float) -> tuple[float, float]:
    """Deviation and degrees of freedom of the inverse chi-square that has the posterior's first two moments."""
    values, vectors = np.linalg.eigh(covariance)
    squares = (vectors.T @ differences) ** 2
    variance = stated_px**2 * np.exp(_GRID)
    total = variance[:, None] + np.maximum(values, 0.0)
    log_density = -0.5 * np.sum(np.log(total) + squares / total, axis=1)
    log_density -= 0.5 * STATED_FREEDOM * (_GRID + stated_px**2 / variance)
    density = np.exp(log_density - log_density.max())
    density /= density.sum()
    # The inverse variance has a gamma distribution of mean 1 / size^2 and variance 2 / (freedom size^4).
    mean = float(density @ (1.0 / variance))
    spread = float(density @ (1.0 / variance - mean) ** 2)
    return float(np.sqrt(1.0 / mean)), 2.0 * mean**2 / max(spread, 1e-12 * mean**2)
