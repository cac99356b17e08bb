"""The components of an estimate's errors and the covariance that follows, for all pairs or for some.

The estimate p of least squares with priors is off by Q (J^T e / sigma^2 + P e_p) with Q = (J^T J / sigma^2 + P)^-1.
The pairs' errors e are noise of variance sigma^2, what blocks of pairs share (`variance_components`), and what all
pairs share (`common_errors`); the priors' errors e_p have the covariance P^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.polish import weighted_residuals
from workers.solver.problem import FitProblem
from workers.solver.uncertainty import turns_are_free
from workers.solver.variance_components import Components, Linearised

Floats = NDArray[np.float64]
Used = NDArray[np.bool_]
_OPEN: Final = 1e-14
"""Share of the largest eigenvalue below which pairs tell nothing of a direction."""
_LEAST_SHARE: Final = 0.5  # of the degrees of freedom: of fewer pairs the residuals tell the noise hardly
Arm = tuple[Floats, Used | None]
"""An estimate's Q (F, F), with its sign in a difference, and the pairs (N,) that it is from; None: all."""


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """The errors of a fit that is linearised at its end.

    fit: with columns of unit length; scale (F,): what the parameters (rad, m, px) were divided by for that.
    noise: sigma^2, px^2. common (N, 2, m): what all pairs share, px per standard deviation; terms (m,): the name of
    each column's error. The last `estimated` of its columns have one variance, known with `common_freedom` degrees of
    freedom. shared: what blocks share; groups come before the time blocks that they are in. variances (K,): of all
    their components, one after the other. unsure (1 + K, 1 + K): the covariance of the estimates of noise and
    variances.
    moved (F,): what pairs that do not belong moved the estimate by.
    """

    fit: Linearised
    scale: Floats
    noise: float
    common: Floats
    terms: tuple[str, ...]
    unsure: Floats
    shared: tuple[Components, ...] = ()
    variances: Floats = field(default_factory=lambda: np.zeros(0))
    estimated: int = 0
    common_freedom: float = np.inf
    moved: Floats = field(default_factory=lambda: np.zeros(0))

    def inverse(self, used: Used | None = None) -> Floats:
        """Q (F, F) of the used pairs (N,), in scaled parameters; priors count whole."""
        J = self._rows(used).reshape(-1, len(self.scale))
        return np.linalg.pinv(J.T @ J / self.noise + self.fit.prior, rcond=_OPEN, hermitian=True).astype(np.float64)

    def determines(self, used: Used) -> bool:
        """Whether the used pairs (N,) and the priors determine every parameter."""
        J = self._rows(used).reshape(-1, len(self.scale))
        values = np.linalg.eigvalsh(J.T @ J / self.noise + self.fit.prior)
        return bool(values[0] > _OPEN * values[-1])

    def step(self, used: Used | None = None) -> Floats:
        """(F,) the step from the linearisation to the optimum of the used pairs and the priors: rad, m, px."""
        J = self._rows(used).reshape(-1, len(self.scale))
        gradient = J.T @ self.fit.residuals.ravel() / self.noise + self.fit.pull
        return -(self.inverse(used) @ gradient) * self.scale

    def without(self, term: str) -> ErrorModel:
        """The same without what that term of the common errors adds."""
        rest = np.array([name != term for name in self.terms], np.bool_)
        terms = tuple(name for name in self.terms if name != term)
        return replace(self, common=self.common[:, :, rest], terms=terms)

    def with_own_noise(self) -> ErrorModel:
        """The same with the noise that is left when what all pairs share is fitted beside the parameters."""
        beside = self.with_columns(self.common, 1.0)
        J = beside.fit.jacobian.reshape(-1, len(beside.scale))
        left = self.fit.residuals.ravel() + J @ (beside.step() / beside.scale)
        variance = float(self.unsure[0, 0])
        freedom = 2.0 * self.noise**2 / variance if variance > 0.0 else np.inf
        taken = beside._taken() - self._taken()
        share = float(np.sum(left**2) / np.sum(self.fit.residuals**2)) / max(1.0 - taken / freedom, _LEAST_SHARE)
        return replace(self, noise=share * self.noise, unsure=share**2 * self.unsure)

    def _taken(self) -> float:
        """Degrees of freedom that the unknowns take of the residuals: the trace of the hat matrix."""
        J = self.fit.jacobian.reshape(-1, len(self.scale))
        return float(np.sum(self.inverse() * (J.T @ J))) / self.noise

    def with_columns(self, columns: Floats, sigma: float = np.inf) -> ErrorModel:
        """The same fit with further unknowns, by their derivatives (N, 2, e); each is zero, give or take sigma."""
        more = columns.shape[2]
        lengths = np.sqrt(np.sum(columns**2, axis=(0, 1)))
        scale = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
        fit = Linearised(
            self.fit.residuals,
            np.concatenate([self.fit.jacobian, columns * scale], axis=2),
            np.pad(self.fit.prior, (0, more)) + np.diag(np.pad((scale / sigma) ** 2, (len(self.scale), 0))),
            np.pad(self.fit.pull, (0, more)),
        )
        return replace(self, fit=fit, scale=np.concatenate([self.scale, scale]), moved=np.zeros(0))

    def parts(self, *halves: Used) -> list[Floats]:
        """(F, F) each: how the covariance grows with sigma^2 and with the variance of each shared component.

        Of the estimate from all pairs, or of the difference of the estimates from two disjoint `halves` of them.
        """
        return [self._in_units(part) for part in self._parts(self._arms(halves))]

    def by_common(self, used: Used | None = None) -> Floats:
        """(F, m) what one standard deviation of each common error moves the estimate by: rad, m, px."""
        return self._by_common(self.inverse(used), used) * self.scale[:, None]

    def covariance(self, used: Used | None = None) -> Floats:
        """(F, F) of the estimate from all pairs, or from the used ones: rad, m, px."""
        covariance = self._of_arms([(self.inverse(used), used)])
        return covariance + np.outer(self.moved, self.moved) if self.moved.size else covariance

    def freedoms(self) -> Floats:
        """(F,) degrees of freedom of the estimate's variances (Satterthwaite 1946)."""
        parts = np.stack([np.diag(part) for part in self.parts()], axis=1)
        unsure = np.einsum("fi,ij,fj->f", parts, self.unsure, parts)
        if self.estimated:
            of_people = self.by_common()[:, -self.estimated :]
            unsure = unsure + 2.0 * np.sum(of_people**2, axis=1) ** 2 / self.common_freedom
        with np.errstate(divide="ignore", invalid="ignore"):
            return 2.0 * np.diag(self.covariance()) ** 2 / unsure

    def freedom_of(self, shares: Floats) -> float:
        """Degrees of freedom of a stated mean square of 1 that grows by shares (1 + K,) with the variances."""
        unsure = float(shares @ self.unsure @ shares)
        return 2.0 / unsure if unsure > 0.0 else np.inf

    def difference(self, first: Used, second: Used) -> Floats:
        """(F, F) of the difference of the estimates from the first and the second pairs, which are disjoint."""
        return self._of_arms(self._arms((first, second)))

    def of_pairs(self) -> ErrorModel:
        """The same without what all pairs share."""
        return replace(self, common=self.common[:, :, :0], terms=(), estimated=0, moved=np.zeros(0))

    def _arms(self, halves: Sequence[Used]) -> list[Arm]:
        if not halves:
            return [(self.inverse(), None)]
        first, second = halves
        return [(self.inverse(first), first), (-self.inverse(second), second)]

    def _of_arms(self, arms: Sequence[Arm]) -> Floats:
        by_common = np.zeros((len(self.scale), self.common.shape[2]))
        for inverse, rows in arms:
            by_common += self._by_common(inverse, rows)
        variances = [self.noise, *self.variances.tolist()]
        total = np.sum([v * part for v, part in zip(variances, self._parts(arms), strict=True)], axis=0)
        by_prior = np.sum([inverse for inverse, _ in arms], axis=0)
        total += by_prior @ self.fit.prior @ by_prior + by_common @ by_common.T
        return self._in_units(total)

    def _parts(self, arms: Sequence[Arm]) -> list[Floats]:
        size = len(self.scale)
        parts = np.zeros((1 + len(self.variances), size, size))
        for inverse, rows in arms:
            Q, J = inverse / self.noise, self._rows(rows).reshape(-1, size)
            parts[0] += Q @ (J.T @ J) @ Q
            for k in range(len(self.variances)):
                parts[1 + k] += Q @ self._of_component(rows, k) @ Q
        return list(parts)

    def _by_common(self, inverse: Floats, used: Used | None) -> Floats:
        return inverse @ np.einsum("ncf,ncm->fm", self._rows(used), self.common) / self.noise

    def _of_component(self, used: Used | None, k: int) -> Floats:
        components, column = [
            (each, column) for each in self.shared for column in range(int(each.component.max()) + 1)
        ][k]
        of_pairs = np.einsum(
            "nci,ncf->nif", components.shapes[:, :, components.component == column], self._rows(used)
        )
        of_blocks = np.zeros((int(components.labels.max()) + 1, *of_pairs.shape[1:]))
        np.add.at(of_blocks, components.labels, of_pairs)
        rows = of_blocks.reshape(-1, len(self.scale))
        return rows.T @ rows

    def _rows(self, used: Used | None) -> Floats:
        return self.fit.jacobian if used is None else self.fit.jacobian * used[:, None, None]

    def _in_units(self, covariance: Floats) -> Floats:
        return covariance * self.scale[:, None] * self.scale


def linearised(problem: FitProblem, p: Floats) -> tuple[Linearised, Floats]:
    """A whitened problem's fit at p (D,), with columns of unit length, and the parameters' divisors."""
    residuals, rows = weighted_residuals(problem, p, turns_are_free(problem))
    lengths = np.linalg.norm(rows, axis=0)
    scale = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
    rows = rows * scale
    of_marks = 2 * len(problem.points)
    # A prior's rows were made under the noise that the problem states.
    of_priors = rows[of_marks:] / (problem.noise_scale * problem.mark_sigma_px) ** 2
    return Linearised(
        residuals[:of_marks].reshape(-1, 2),
        rows[:of_marks].reshape(len(problem.points), 2, -1),
        of_priors.T @ rows[of_marks:],
        of_priors.T @ residuals[of_marks:],
    ), scale


def weighed(problem: FitProblem, values: Floats) -> Floats:
    """Derivatives (N, 2, q) of the pixels as they count in a whitened problem: weighted or whitened."""
    rows = values if problem.whitening is None else np.matmul(problem.whitening, values)
    return rows * np.sqrt(problem.weights)[:, None, None]
