"""The estimate at the end of a run: the fit, the pairs it uses, the noise of the marks, and the covariance."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.precision import PersonBias, SharedErrors
from apexcal.documents.results import Outlier
from apexcal.geometry.rotations import vector_from_rotation
from workers.solver.common_errors import common_errors
from workers.solver.error_model import ErrorModel, linearised
from workers.solver.lens_priors import lens_priors
from workers.solver.outcomes import Outcome
from workers.solver.outliers import judge, without
from workers.solver.people import with_people
from workers.solver.polish import Fit, polish, refine
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.shared_errors import shared_errors
from workers.solver.uncertainty import Uncertainty, turns_are_free, uncertainty, units_of
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# Rounds of fit and noise. Each changes the noise by about the share of the parameters that the priors hold.
_ROUNDS: Final = 10
_SETTLED: Final = 1e-3
# Pairs that were computed: what remains of them is rounding, and tells of no errors.
_NO_NOISE_PX: Final = 1e-6


@dataclass(frozen=True)
class Estimate:
    """One estimate of a problem, which status, checks, documents and evaluation all read.

    fit: the polish of `fitted`. outcome: how the fits ended, of polish and outliers that which did not converge, if
    any. outliers: the pairs that the others speak against, the worst first. fitted: the problem as it was polished;
    outliers have weight 0 where the problem excludes them. holding: the problem of the pairs that hold the
    parameters, without outliers. kept: the fit of `holding` if outliers moved the other one; how far they moved it
    counts as a deviation. spread: the covariance and the noise of these marks, with what pairs share. errors: what
    the covariance is made of; plain: the same without what blocks share; wider: the same with what blocks share, also
    if it is too small to count; shared: what blocks share. They are None if the pairs leave a direction open or show
    no noise, and `wider` and `shared` also if there are no blocks. bias: of the people who marked, if the problem
    states its deviation.
    weak: standard deviations of the weak priors that hold distortion terms, by name.
    """

    fit: Fit
    outcome: Outcome
    outliers: list[Outlier]
    fitted: FitProblem
    holding: FitProblem
    spread: Uncertainty
    kept: Fit | None = None
    errors: ErrorModel | None = None
    plain: ErrorModel | None = None
    wider: ErrorModel | None = None
    shared: SharedErrors | None = None
    bias: PersonBias | None = None
    weak: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def parameters(self) -> Floats:
        """The parameter vector (D,) in the order of `fitted.names`."""
        return np.array(self.fit.parameters)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the deviations without what all pairs share: the median, or that of the noise."""
        if self.errors is not None:
            return float(np.median(self.errors.of_pairs().freedoms()))
        return np.inf if self.spread.freedom is None else self.spread.freedom

    @property
    def held_at(self) -> Floats:
        """The parameters (D,) of the fit to the pairs of `holding`."""
        return self.parameters if self.kept is None else np.array(self.kept.parameters)


def estimate(problem: FitProblem, start: Floats) -> Estimate:
    """Polish from `start` (D,), name the outliers, and find the noise and the covariance.

    A prior weighs against the marks by its own sigma and theirs. The marks' sigma is not known beforehand, so where
    there are priors fit and noise are repeated until the noise settles. Distortion that the pairs hardly hold is
    fitted once more, with weak priors.
    """
    found = _settled(problem, polish(problem, start))
    weak = lens_priors(problem, found.parameters, found.spread)
    if weak and found.spread.sigma_px > 0.0:
        held = problem.priors | {name: (0.0, sigma) for name, sigma in weak.items()}
        scale = found.spread.sigma_px / _stated_px(found)
        again = replace(problem, priors=held, noise_scale=scale)
        found = replace(_settled(again, polish(again, _held(problem, found.parameters, weak))), weak=weak)
    return _with_shared_errors(found)


def _settled(problem: FitProblem, fit: Fit) -> Estimate:
    found = _once(problem, fit)
    for _ in range(_ROUNDS if problem.priors else 0):
        scale = found.spread.sigma_px / _stated_px(found)
        if abs(scale - found.fitted.noise_scale) <= _SETTLED * scale:
            break
        again = replace(problem, noise_scale=scale)
        found = _once(again, refine(again, found.parameters))
    return found


def _held(problem: FitProblem, p: Floats, weak: Mapping[str, float]) -> Floats:
    # From a bound the descent would have far to go.
    start = p.copy()
    for name, sigma in weak.items():
        index = problem.names.index(name)
        start[index] = np.clip(start[index], -sigma, sigma)
    return start


def _once(problem: FitProblem, fit: Fit) -> Estimate:
    judged = judge(problem, np.array(fit.parameters), fit if problem.loss == "saturating" else None)
    outliers, outcome = judged.outliers, _worse(fit.outcome, judged.fit.outcome)
    if not outliers and (problem.outliers == "keep" or problem.loss == "mean"):
        spread = uncertainty(problem, np.array(fit.parameters))
        return Estimate(fit, outcome, outliers, problem, problem, spread)
    # Without gross errors plain least squares reaches the Cramer-Rao bound there, a robust loss does not.
    kept = without(replace(problem, loss="mean"), outliers)
    of_kept: Fit | None = None
    if problem.outliers == "exclude":
        fit, fitted = judged.fit, kept
    else:
        fitted = problem
        # A saturating loss gives outliers next to no say.
        of_kept = judged.fit if problem.loss == "mean" else None
    spread = uncertainty(kept, np.array((of_kept or fit).parameters))
    return Estimate(fit, outcome, outliers, fitted, kept, spread, of_kept)


def _worse(fit: Outcome, judged: Outcome) -> Outcome:
    return judged if fit.converged else fit


def _stated_px(found: Estimate) -> float:
    # The noise that the problem states, in px of a typical pair.
    spread = found.spread
    return found.fitted.mark_sigma_px if spread.noise_scale is None else spread.sigma_px / spread.noise_scale


def _with_shared_errors(found: Estimate) -> Estimate:
    spread, p = found.spread, found.held_at
    if spread.rank < len(spread.names) or not spread.names or spread.sigma_px < _NO_NOISE_PX:
        return found
    here = whitened(found.holding, p)
    fit, scale = linearised(here, p)
    noise = spread.sigma_px**2
    unsure = np.array([[2.0 * noise**2 / spread.freedom if spread.freedom else 0.0]])
    alone = ErrorModel(fit, scale, noise, common_errors(here, p), unsure)
    plain, bias = with_people(here, alone)
    plain = replace(plain, moved=_moved(here, found.parameters, p))
    shared = shared_errors(here, p, plain)
    errors = plain if shared is None else shared.errors
    if errors is not plain or plain.common.shape[2] or np.any(plain.moved):
        unit, covariance = units_of(spread.names), errors.covariance()
        spread = replace(
            spread,
            covariance=covariance * unit[:, None] * unit,
            std=np.sqrt(np.diag(covariance)) * unit,
            freedoms=errors.freedoms(),
            shift=errors.moved * unit if errors.moved.size else None,
        )
    named, wider = (shared.named, shared.wider) if shared is not None else (None, None)
    return replace(found, spread=spread, errors=errors, plain=plain, wider=wider, shared=named, bias=bias)


def _moved(problem: FitProblem, to: Floats, begin: Floats) -> Floats:
    """(F,) from one parameter vector to another, as the free parameters' deviations go: rad, m, px."""
    step = to - begin
    if turns_are_free(problem):
        step[:3] = vector_from_rotation(transform_of(problem, to).R @ transform_of(problem, begin).R.T)
    return step[problem.free]
