"""The components of an estimate's errors and the covariance that follows, for all pairs or for some.

The estimate p of least squares with priors is off by Q (J^T e / sigma^2 + P e_p) with Q = (J^T J / sigma^2 + P)^-1.
The pairs' errors e are noise of variance sigma^2, what some pairs share (`correlation`), and what all pairs share
(`common_errors`); the priors' errors e_p have the covariance P^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.correlation import Component, Linearised, Shares
from workers.solver.polish import weighted_residuals
from workers.solver.problem import FitProblem
from workers.solver.uncertainty import turns_are_free

Floats = NDArray[np.float64]
Used = NDArray[np.bool_]
_OPEN: Final = 1e-14
"""Share of the largest eigenvalue below which pairs tell nothing of a direction."""
_STEP: Final = 0.02  # of a logarithm, for a derivative


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """The errors of a fit that is linearised at its end.

    fit: with columns of unit length; scale (F,): what the parameters (rad, m, px) were divided by for that.
    noise: sigma^2, px^2. common (N, 2, m): what all pairs share, px per standard deviation; terms (m,): the name of
    each column's error. The last `estimated` of its columns have one variance, known with `common_freedom` degrees of
    freedom. shared and variances (K,): what some pairs share. unsure (1 + K + L, 1 + K + L): the covariance of the
    logarithms of noise, variances, and the L components' T, as in `Shares`.
    moved (F,): what pairs that do not belong moved the estimate by.
    """

    fit: Linearised
    scale: Floats
    noise: float
    common: Floats
    terms: tuple[str, ...]
    unsure: Floats
    shared: tuple[Component, ...] = ()
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

    def step(self) -> Floats:
        """(F,) the step from the linearisation to the optimum of the pairs and the priors: rad, m, px."""
        return self._step(*self._influence(()))

    def without(self, term: str) -> ErrorModel:
        """Return the model without one term of the common errors."""
        rest = np.array([name != term for name in self.terms], np.bool_)
        terms = tuple(name for name in self.terms if name != term)
        return replace(self, common=self.common[:, :, rest], terms=terms)

    def with_shares(self, shares: Shares) -> ErrorModel:
        """Return the model with this noise and these errors that some pairs share."""
        return replace(
            self, noise=shares.noise, shared=shares.components, variances=shares.variances, unsure=shares.unsure
        )

    def with_columns(self, columns: Floats, sigma: float = np.inf) -> ErrorModel:
        """Return the fit with e further unknowns of mean 0 and deviation sigma, by their derivatives (N, 2, e)."""
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

    def parts(self) -> list[Floats]:
        """(F, F) each: how the covariance of the estimate from all pairs grows with the logarithms of `unsure`."""
        return self._grows(self._influence(())[0])

    def difference(self, first: Used, second: Used) -> tuple[Floats, Floats, list[Floats]]:
        """The estimate from the used pairs (N,) less that from other ones: (F,), its covariance, and its `parts`."""
        influence = self._influence((first, second))
        return self._step(*influence), self._spread(*influence), self._grows(influence[0])

    def _step(self, influence: Floats, by_prior: Floats) -> Floats:
        by_pairs = influence.reshape(-1, len(self.scale)).T @ self.fit.residuals.ravel()
        return -(by_pairs + by_prior @ self.fit.pull)

    def _grows(self, influence: Floats) -> list[Floats]:
        lasting = [
            variance * (each.lasting(1.0 + _STEP).product(influence) - each.lasting(1.0 - _STEP).product(influence))
            for each, variance in zip(self.shared, self.variances.tolist(), strict=True)
            if each.lasts < np.inf
        ]
        return [*self._parts(influence), *(difference / (2.0 * _STEP) for difference in lasting)]

    def by_common(self, *used: Used) -> Floats:
        """(F, m) what one standard deviation of each common error moves the estimate by: rad, m, px."""
        return np.einsum("ncf,ncm->fm", self._influence(used)[0], self.common)

    def covariance(self, *used: Used) -> Floats:
        """(F, F) of the estimate from all pairs, or from the used ones: rad, m, px."""
        total = self._spread(*self._influence(used))
        return total + np.outer(self.moved, self.moved) if self.moved.size else total

    def _spread(self, influence: Floats, by_prior: Floats) -> Floats:
        by_common = np.einsum("ncf,ncm->fm", influence, self.common)
        total = np.sum(self._parts(influence), axis=0) + by_prior @ self.fit.prior @ by_prior.T
        return total + by_common @ by_common.T

    def freedoms(self, along: Floats | None = None) -> Floats:
        """Degrees of freedom of the variances (Satterthwaite 1946): (F,) of the estimate, or (n,) of what moves with
        it as `along` (n, F) says, per rad, m and px. What is stated of common errors has no doubt.
        """
        rows = np.eye(len(self.scale)) if along is None else along
        parts = np.stack([_along(rows, part) for part in self.parts()], axis=1)
        unsure = np.einsum("fi,ij,fj->f", parts, self.unsure, parts)
        if self.estimated:
            of_people = rows @ self.by_common()[:, -self.estimated :]
            unsure = unsure + 2.0 * np.sum(of_people**2, axis=1) ** 2 / self.common_freedom
        with np.errstate(divide="ignore", invalid="ignore"):
            return 2.0 * _along(rows, self.covariance()) ** 2 / unsure

    def freedom_of(self, shares: Floats) -> float:
        """Degrees of freedom of a stated mean square of 1 that grows by shares (1 + K,) with the variances."""
        unsure = float(shares @ self.unsure @ shares)
        return 2.0 / unsure if unsure > 0.0 else np.inf

    def of_pairs(self) -> ErrorModel:
        """Return the model without the errors that all pairs share."""
        return replace(self, common=self.common[:, :, :0], terms=(), estimated=0, moved=np.zeros(0))

    @cached_property
    def _of_all(self) -> tuple[Floats, Floats]:
        return self._anew((None,))

    def _influence(self, used: Sequence[Used]) -> tuple[Floats, Floats]:
        return self._anew(used) if used else self._of_all

    def _anew(self, used: Sequence[Used | None]) -> tuple[Floats, Floats]:
        """(N, 2, F) what a pixel of each pair's error moves the estimate, or the difference of two, by; (F, F) what
        the priors' pull moves it by. Rad, m, px.
        """
        of_pairs, by_prior = np.zeros_like(self.fit.jacobian), np.zeros_like(self.fit.prior)
        for sign, rows in zip((1.0, -1.0), used, strict=False):
            Q = sign * self.inverse(rows) * self.scale
            of_pairs += self._rows(rows) @ Q / self.noise
            by_prior += Q.T
        return of_pairs, by_prior

    def _parts(self, influence: Floats) -> list[Floats]:
        flat = influence.reshape(-1, len(self.scale))
        shared = zip(self.shared, self.variances.tolist(), strict=True)
        return [self.noise * (flat.T @ flat), *(variance * each.product(influence) for each, variance in shared)]

    def _rows(self, used: Used | None) -> Floats:
        return self.fit.jacobian if used is None else self.fit.jacobian * used[:, None, None]


def _along(rows: Floats, covariance: Floats) -> Floats:
    return np.einsum("nf,fg,ng->n", rows, covariance, rows)


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


def unweighed(problem: FitProblem, values: Floats) -> Floats:
    """Pixels (N, 2) of such as count in a whitened problem; 0 where a pair counts nothing."""
    root = np.sqrt(problem.weights)[:, None]
    plain = np.divide(values, root, out=np.zeros_like(values), where=root > 0.0)
    if problem.whitening is not None:
        plain = np.asarray(np.linalg.solve(problem.whitening, plain[..., None])[..., 0], np.float64)
    return plain
