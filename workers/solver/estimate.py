"""The estimate at the end of a run: the fit, the pairs it uses, the noise of the marks, and the covariance."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.common_errors import common_errors
from workers.solver.error_model import ErrorModel, linearised
from workers.solver.lens_priors import lens_priors
from workers.solver.outcomes import Outcome
from workers.solver.outliers import Outlier, judge, without
from workers.solver.polish import Fit, polish
from workers.solver.problem import FitProblem
from workers.solver.shared_errors import SharedErrors, shared_errors
from workers.solver.uncertainty import Uncertainty, uncertainty, units_of
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# Rounds of fit and noise. Each changes the noise by about the share of the parameters that the priors hold.
_ROUNDS: Final = 10
_SETTLED: Final = 1e-3
# Pairs that were computed: what remains of them is rounding, and tells of no errors.
_NO_NOISE_PX: Final = 1e-6


@dataclass(frozen=True)
class Estimate:
    """One estimate of a problem, which status, alarms, documents and evaluation all read.

    fit: the polish of `fitted`. outcome: how the fits ended, of polish and outliers that which did not converge, if
    any. outliers: the pairs that the others speak against, the worst first. fitted: the
    problem as it was polished; outliers have weight 0 where the problem excludes them. holding: the problem of the
    pairs that hold the parameters: a robust loss gives outliers next to no say, so they do not count there either.
    spread: the covariance and the noise of these marks, with what pairs share. errors: what the covariance is made
    of, and shared: what blocks of pairs share; None where the pairs leave a direction open, show no noise, or have no
    blocks.
    weak: standard deviations of the weak priors that hold distortion terms, by name.
    """

    fit: Fit
    outcome: Outcome
    outliers: list[Outlier]
    fitted: FitProblem
    holding: FitProblem
    spread: Uncertainty
    errors: ErrorModel | None = None
    shared: SharedErrors | None = None
    weak: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def parameters(self) -> Floats:
        """The parameter vector (D,) in the order of `fitted.names`."""
        return np.array(self.fit.parameters)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of what is stated: the median of those of the parameters, or of the noise."""
        spread = self.spread
        if spread.freedoms is not None:
            return float(np.median(spread.freedoms))
        return np.inf if spread.freedom is None else spread.freedom


def estimate(problem: FitProblem, start: Floats) -> Estimate:
    """Polish from `start` (D,), name the outliers, and find the noise and the covariance.

    A prior weighs against the marks by its own sigma and theirs. The marks' sigma is not known beforehand, so where
    there are priors fit and noise are repeated until the noise settles. Distortion that the pairs hardly hold is
    fitted once more, with weak priors.
    """
    found = _settled(problem, start)
    weak = lens_priors(problem, found.parameters, found.spread)
    if weak and found.spread.sigma_px > 0.0:
        held = problem.priors | {name: (0.0, sigma) for name, sigma in weak.items()}
        scale = found.spread.sigma_px / _stated_px(found)
        again = replace(problem, priors=held, noise_scale=scale)
        found = replace(_settled(again, _held(problem, found.parameters, weak)), weak=weak)
    return _with_shared_errors(found)


def _settled(problem: FitProblem, start: Floats) -> Estimate:
    found = _once(problem, start)
    for _ in range(_ROUNDS if problem.priors else 0):
        scale = found.spread.sigma_px / _stated_px(found)
        if abs(scale - found.fitted.noise_scale) <= _SETTLED * scale:
            break
        found = _once(replace(problem, noise_scale=scale), found.parameters)
    return found


def _held(problem: FitProblem, p: Floats, weak: Mapping[str, float]) -> Floats:
    # From a bound the descent would have far to go.
    start = p.copy()
    for name, sigma in weak.items():
        index = problem.names.index(name)
        start[index] = np.clip(start[index], -sigma, sigma)
    return start


def _once(problem: FitProblem, start: Floats) -> Estimate:
    fit = polish(problem, start)
    judged = judge(problem, np.array(fit.parameters))
    outliers = judged.outliers
    if not outliers:
        spread = uncertainty(problem, np.array(fit.parameters))
        return Estimate(fit, _worse(fit.outcome, judged.outcome), outliers, problem, problem, spread)
    # No gross errors are left: plain least squares reaches the Cramer-Rao bound there, a robust loss does not.
    kept = without(replace(problem, loss="mean"), outliers)
    if problem.outliers == "exclude":
        fit, fitted = polish(kept, fit.parameters), kept
    else:
        fitted = problem
    holding = fitted if problem.loss == "mean" and problem.outliers == "keep" else kept
    spread = uncertainty(holding, np.array(fit.parameters))
    return Estimate(fit, _worse(fit.outcome, judged.outcome), outliers, fitted, holding, spread)


def _worse(fit: Outcome, judged: Outcome) -> Outcome:
    return judged if fit.converged else fit


def _stated_px(found: Estimate) -> float:
    # The noise that the problem states, in px of a typical pair.
    spread = found.spread
    return found.fitted.mark_sigma_px if spread.noise_scale is None else spread.sigma_px / spread.noise_scale


def _with_shared_errors(found: Estimate) -> Estimate:
    spread = found.spread
    if spread.rank < len(spread.names) or not spread.names or spread.sigma_px < _NO_NOISE_PX:
        return found
    here = whitened(found.holding, found.parameters)
    fit, scale = linearised(here, found.parameters)
    plain = ErrorModel(fit, scale, spread.sigma_px**2, common_errors(here, found.parameters))
    shared = shared_errors(here, found.parameters, plain)
    if shared is None or not shared[0].counted:
        errors, kept = plain, None
    else:
        errors, kept = shared[1], shared[0]
    if kept is not None or plain.common.shape[2]:
        spread = _wider(spread, errors, kept)
    return replace(found, spread=spread, errors=errors, shared=shared and shared[0])


def _wider(spread: Uncertainty, errors: ErrorModel, shared: SharedErrors | None) -> Uncertainty:
    """The deviations of these errors, each with its degrees of freedom."""
    covariance = errors.covariance()
    variance = np.diag(covariance)
    parts = np.stack([np.diag(part) for part in errors.parts()], axis=1)
    if shared is not None:
        free = shared.variances.free
        unsure = np.linalg.pinv(shared.variances.information[np.ix_(free, free)], hermitian=True)
        spread_of_variance = np.einsum("fi,ij,fj->f", parts[:, free], unsure, parts[:, free])
    elif spread.freedom is not None:
        spread_of_variance = 2.0 * (parts[:, 0] * errors.noise) ** 2 / spread.freedom
    else:
        spread_of_variance = np.zeros(len(variance))
    unit = units_of(spread.names)
    with np.errstate(divide="ignore"):
        freedoms = 2.0 * variance**2 / spread_of_variance
    return replace(
        spread, covariance=covariance * unit[:, None] * unit, std=np.sqrt(variance) * unit, freedoms=freedoms
    )
