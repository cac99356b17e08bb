"""The estimate at the end of a run: the fit, the pairs it uses, the noise of the marks, and the covariance."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solver.outcomes import Outcome
from workers.solver.outliers import Outlier, judge, without
from workers.solver.polish import Fit, polish
from workers.solver.problem import FitProblem
from workers.solver.uncertainty import Uncertainty, uncertainty

Floats = NDArray[np.float64]
# Rounds of fit and noise. Each changes the noise by about the share of the parameters that the priors hold.
_ROUNDS: Final = 10
_SETTLED: Final = 1e-3


@dataclass(frozen=True)
class Estimate:
    """One estimate of a problem, which status, alarms, documents and evaluation all read.

    fit: the polish of `fitted`. outcome: how the fits ended, of polish and outliers that which did not converge, if
    any. outliers: the pairs that the others speak against, the worst first. fitted: the
    problem as it was polished; outliers have weight 0 where the problem excludes them. spread: the covariance and
    the noise of the marks, over the pairs that hold the parameters: a robust loss gives outliers next to no say,
    so they do not count there either.
    """

    fit: Fit
    outcome: Outcome
    outliers: list[Outlier]
    fitted: FitProblem
    spread: Uncertainty

    @property
    def parameters(self) -> Floats:
        """The parameter vector (D,) in the order of `fitted.names`."""
        return np.array(self.fit.parameters)


def estimate(problem: FitProblem, start: Floats) -> Estimate:
    """Polish from `start` (D,), name the outliers, and find the noise and the covariance.

    A prior weighs against the marks by its own sigma and theirs. The marks' sigma is not known beforehand, so where
    there are priors fit and noise are repeated until the noise settles.
    """
    found = _once(problem, start)
    for _ in range(_ROUNDS if problem.priors else 0):
        scale = found.spread.sigma_px / _stated_px(found)
        if abs(scale - found.fitted.noise_scale) <= _SETTLED * scale:
            break
        found = _once(replace(problem, noise_scale=scale), found.parameters)
    return found


def _once(problem: FitProblem, start: Floats) -> Estimate:
    fit = polish(problem, start)
    judged = judge(problem, np.array(fit.parameters))
    outliers = judged.outliers
    if not outliers:
        spread = uncertainty(problem, np.array(fit.parameters))
        return Estimate(fit, _worse(fit.outcome, judged.outcome), outliers, problem, spread)
    # No gross errors are left: plain least squares reaches the Cramer-Rao bound there, a robust loss does not.
    kept = without(replace(problem, loss="mean"), outliers)
    if problem.outliers == "exclude":
        fit, fitted = polish(kept, fit.parameters), kept
    else:
        fitted = problem
    holding = fitted if problem.loss == "mean" and problem.outliers == "keep" else kept
    spread = uncertainty(holding, np.array(fit.parameters))
    return Estimate(fit, _worse(fit.outcome, judged.outcome), outliers, fitted, spread)


def _worse(fit: Outcome, judged: Outcome) -> Outcome:
    return judged if fit.converged else fit


def _stated_px(found: Estimate) -> float:
    # The noise that the problem states, in px of a typical pair.
    spread = found.spread
    return found.fitted.mark_sigma_px if spread.noise_scale is None else spread.sigma_px / spread.noise_scale
