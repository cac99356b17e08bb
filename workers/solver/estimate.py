"""The estimate at the end of a run: the fit, the pairs it uses, the noise of the marks, and the covariance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.camera_models import CAMERA_MODELS
from apexcal.documents.precision import FittedOffset, PersonBias, SharedErrors
from apexcal.documents.results import Outlier
from apexcal.geometry.rotations import vector_from_rotation
from workers.solver.common_errors import beside_decentring, column_of, common_errors, with_people
from workers.solver.error_model import ErrorModel, linearised
from workers.solver.outcomes import Outcome
from workers.solver.outliers import judge, without
from workers.solver.polish import Fit, cost_of, polish, refine
from workers.solver.problem import ASPECT, FitProblem
from workers.solver.residuals import transform_of
from workers.solver.shared_errors import own_noise, shared_errors
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
    counts as a deviation. spread: the covariance and the noise of these marks, with what pairs share and a fisheye's
    decentring. errors: what the covariance is made of where mount and lens are used together; plain: the same without
    what blocks share; wider: the same with what blocks share, also if it is too small to count; shared: what blocks
    share. They are None if the pairs leave a direction open or show no noise, and `wider` and `shared` also if there
    are no blocks. bias: of the people who marked, if the problem states its deviation.
    weak: standard deviations of the weak priors that hold distortion terms and the aspect, by name.
    clock: the clocks' offset beyond the stated one, if the pairs tell it; `fitted` and `holding` are moved by it.
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
    clock: FittedOffset | None = None

    @property
    def parameters(self) -> Floats:
        """The parameter vector (D,) in the order of `fitted.names`."""
        return np.array(self.fit.parameters)

    @property
    def held_at(self) -> Floats:
        """The parameters (D,) of the fit to the pairs of `holding`."""
        return self.parameters if self.kept is None else np.array(self.kept.parameters)


def estimate(problem: FitProblem, start: Floats, descend: Callable[[FitProblem, Floats], Fit] = polish) -> Estimate:
    """Polish from `start` (D,), name the outliers, and find the noise and the covariance.

    descend: `refine` where the start is an end of `polish` already.

    A prior weighs against the marks by its own sigma and theirs. The marks' sigma is not known beforehand, so where
    there are priors fit and noise are repeated until the noise settles. Distortion and aspect that the pairs hardly
    hold are fitted once more, with weak priors. So is everything if the pairs tell the clocks' offset.
    """
    result = _estimate(problem, start, descend)
    clock = _clock(result)
    if clock is None:
        return result
    return replace(_estimate(at_clock(problem, clock), result.parameters, refine), clock=clock)


def _estimate(problem: FitProblem, start: Floats, descend: Callable[[FitProblem, Floats], Fit]) -> Estimate:
    result = _settled(problem, descend(problem, start))
    weak = lens_priors(problem, result.parameters, result.spread) | _aspect_prior(result)
    if weak and result.spread.sigma_px > 0.0:
        priors = problem.priors | {name: (float(name == ASPECT), sigma) for name, sigma in weak.items()}
        scale = result.spread.sigma_px / _stated_px(result)
        again = replace(problem, priors=priors, noise_scale=scale)
        result = replace(_settled(again, polish(again, _held(problem, result.parameters, weak))), weak=weak)
    return _with_shared_errors(result)


def _clock(result: Estimate) -> FittedOffset | None:
    """The clocks' offset if these pairs tell it better than it is stated and do not contradict it.

    It is a further unknown without a prior, because an estimate from the same marks says nothing more: the covariance
    with its deviation as a common error is that of the fit with this unknown.
    """
    stated_ms = result.holding.common_errors.get("clock_ms", 0.0)
    if result.errors is None or stated_ms == 0.0:
        return None
    problem = whitened(result.holding, result.held_at)
    column = column_of(problem, result.held_at, "clock_ms")
    wider = result.errors.without("clock_ms").with_columns(column)
    if not wider.determines(problem.weights > 0.0):
        return None
    offset_ms, std_ms = float(wider.step()[-1]), float(np.sqrt(wider.covariance()[-1, -1]))
    if std_ms >= _BETTER * stated_ms or abs(offset_ms) > _CONTRADICTED * np.hypot(std_ms, stated_ms):
        return None
    return FittedOffset(offset_ms=offset_ms, std_ms=std_ms)


def at_clock(problem: FitProblem, clock: FittedOffset | None) -> FitProblem:
    """A problem of pairs (of any of a recording) at the times that an estimate's `clock` says; the same without."""
    if clock is None:
        return problem
    # A later camera clock looks at an earlier moment of the walk.
    moved = problem.moved_by(-1e-3 * clock.offset_ms)
    return replace(moved, common_errors=problem.common_errors | {"clock_ms": clock.std_ms})


def _settled(problem: FitProblem, fit: Fit) -> Estimate:
    result = _once(problem, fit)
    for _ in range(_ROUNDS if problem.priors else 0):
        scale = result.spread.sigma_px / _stated_px(result)
        if abs(scale - result.fitted.noise_scale) <= _SETTLED * scale:
            break
        again = replace(problem, noise_scale=scale)
        result = _once(again, refine(again, result.parameters))
    return result


def _held(problem: FitProblem, p: Floats, weak: Mapping[str, float]) -> Floats:
    # From a bound the descent would have far to go.
    start = p.copy()
    for name in weak.keys() - {ASPECT}:
        index, sigma = problem.names.index(name), weak[name]
        start[index] = np.clip(start[index], -sigma, sigma)
    return start


def _once(problem: FitProblem, fit: Fit) -> Estimate:
    judged = judge(problem, np.array(fit.parameters), fit if problem.loss == "saturating" else None)
    outliers, outcome = judged.outliers, _worse(fit.outcome, judged.fit.outcome)
    if not outliers and (problem.outliers == "keep" or problem.loss == "mean"):
        spread = uncertainty(problem, np.array(fit.parameters))
        return Estimate(fit, outcome, outliers, problem, problem, spread)
    # Without gross errors plain least squares reaches the Cramer-Rao bound there, a robust loss does not.
    inliers = without(replace(problem, loss="mean"), outliers)
    of_kept: Fit | None = None
    if problem.outliers == "exclude":
        fit, fitted = judged.fit, inliers
    else:
        fitted = problem
        # A saturating loss gives outliers next to no say.
        of_kept = judged.fit if problem.loss == "mean" else None
    spread = uncertainty(inliers, np.array((of_kept or fit).parameters))
    return Estimate(fit, outcome, outliers, fitted, inliers, spread, of_kept)


def _worse(fit: Outcome, judged: Outcome) -> Outcome:
    return judged if fit.converged else fit


def _stated_px(result: Estimate) -> float:
    # The noise that the problem states, in px of a typical pair.
    spread = result.spread
    return result.fitted.mark_sigma_px if spread.noise_scale is None else spread.sigma_px / spread.noise_scale


def _with_shared_errors(result: Estimate) -> Estimate:
    spread, p = result.spread, result.held_at
    if spread.rank < len(spread.names) or not spread.names or spread.sigma_px < _NO_NOISE_PX:
        return result
    here = whitened(result.holding, p)
    fit, scale = linearised(here, p)
    unsure = np.array([[2.0 / spread.freedom if spread.freedom else 0.0]])
    alone = ErrorModel(fit, scale, spread.sigma_px**2, *common_errors(here, p), unsure)
    plain, bias = with_people(here, alone)
    # A planned noise has no residuals to be told from.
    plain = own_noise(plain) if plain.terms and spread.freedom else plain
    plain = replace(plain, noise=max(plain.noise, _least_noise(here)))
    plain = replace(plain, moved=_moved(here, result.parameters, p))
    shared = shared_errors(here, p, plain)
    errors = plain if shared is None else shared.errors
    stated = beside_decentring(here, p, errors)
    if stated is not plain or plain.common.shape[2] or np.any(plain.moved) or plain.noise > alone.noise:
        unit, free = units_of(spread.names), slice(len(spread.names))
        covariance = stated.covariance()[free, free]
        spread = replace(
            spread,
            covariance=covariance * unit[:, None] * unit,
            std=np.sqrt(np.diag(covariance)) * unit,
            freedoms=stated.freedoms()[free],
            shift=stated.moved[free] * unit if stated.moved.size else None,
        )
    named, wider = (shared.named, shared.wider) if shared is not None else (None, None)
    return replace(result, spread=spread, errors=errors, plain=plain, wider=wider, shared=named, bias=bias)


def _least_noise(problem: FitProblem) -> float:
    """The least noise (px^2) of a whitened problem's pairs: what they state, where they are too few for blocks.

    What pairs share is no scatter. Blocks tell how large it is; fewer pairs may be off by what they state, however
    little they scatter (errors are scaled up by residuals, never down: Birge 1932; Particle Data Group).
    """
    stated = problem.covariances
    states_points = stated is not None and bool(np.any(stated.points))
    return problem.mark_sigma_px**2 if states_points and problem.blocks is None else 0.0


def _moved(problem: FitProblem, to: Floats, begin: Floats) -> Floats:
    """(F,) from one parameter vector to another, as the free parameters' deviations go: rad, m, px."""
    step = to - begin
    if turns_are_free(problem):
        step[:3] = vector_from_rotation(transform_of(problem, to).R @ transform_of(problem, begin).R.T)
    return step[problem.free]


_LARGEST: Final = 0.2
_AT_CORNER: Final = 0.3
"""One standard deviation of a term: this share of the radius at the image's corner, at most 0.2.
`docs/uncertainty.md` has the measurement."""
_DECENTRED: Final = 0.1
"""Tangential terms are the first radial one of a lens off its axis by this share of the corner's radius
(Conrady 1919)."""
_ASPECT: Final = 0.005
"""One standard deviation of f_y / f_x: pixels are square, and published lenses differ from one by 0.0039 (root mean
square; `docs/uncertainty.md`)."""
_CONTRADICTED: Final = 4.0  # standard deviations; errors that last, found only later, bring sound fits beyond three
_BETTER: Final = 0.9  # of a stated deviation: what tells it less is not worth another fit
_RADIAL: Final = {
    "pinhole": {},
    "brown_conrady": {"k1": 1, "k2": 2, "k5": 3},
    "kannala_brandt": {"k1": 1, "k2": 2, "k3": 3, "k4": 4},
    "rational_polynomial": {"k1": 1, "k2": 2, "k3": 3, "k4": 1, "k5": 2, "k6": 3},
}


def lens_priors(problem: FitProblem, p: Floats, spread: Uncertainty) -> dict[str, float]:
    """Standard deviations about zero, by coefficient, for a fit that ended at p (D,) with these deviations.

    Empty if the pairs determine all coefficients or leave other parameters open, or if the request constrains all
    coefficients.
    """
    corner = _corner(problem, p)
    sigmas = {name: _radial(corner, order) for name, order in _RADIAL[problem.model].items()}
    for name in CAMERA_MODELS[problem.model].tangential:
        sigmas[name] = _DECENTRED * corner * _radial(corner, 1)
    std = dict(zip(spread.names, spread.std.tolist(), strict=True))
    open_names = [name for name in sigmas if name in problem.unstated and name in std]
    if not all(np.isfinite(deviation) for name, deviation in std.items() if name not in open_names):
        return {}  # no prior of the lens helps other open parameters
    # The bounds are five of the largest deviation away: a coefficient better determined than its prior stays inside.
    if all(std[name] < sigmas[name] for name in open_names):
        return {}
    return {name: sigmas[name] for name in open_names}


def _aspect_prior(result: Estimate) -> dict[str, float]:
    """The standard deviation of `ASPECT` about one, if the pairs determine it less well and do not contradict it.

    Empty also where the request says something of f_x or f_y.
    """
    problem, p, spread = result.holding, result.held_at, result.spread
    focal = [spread.names.index(name) for name in ("f_x", "f_y") if name in spread.names and name in problem.unstated]
    if len(focal) < 2 or spread.sigma_px <= 0.0:
        return {}
    slope = np.array([-p[7] / p[6], 1.0]) / p[6]
    # Not a number, and so not below, where one of them is open.
    if float(slope @ spread.covariance[np.ix_(focal, focal)] @ slope) <= _ASPECT**2:
        return {}
    priors = problem.priors | {ASPECT: (1.0, _ASPECT)}
    square = replace(problem, priors=priors, noise_scale=spread.sigma_px / _stated_px(result))
    here = whitened(square, p)
    worse = cost_of(here, refine(square, p).parameters) - cost_of(replace(here, priors=problem.priors), p)
    return {ASPECT: _ASPECT} if worse <= (_CONTRADICTED * spread.sigma_px) ** 2 else {}


def _corner(problem: FitProblem, p: Floats) -> float:
    """Return the corner's undistorted radius; a fisheye's is an angle, by its scale at the outermost pair."""
    grown = 0.5 * problem.diagonal_px / float(np.sqrt(p[6] * p[7]))
    if problem.model != "kannala_brandt":
        return grown
    x, y, z = transform_of(problem, p).apply(problem.points[problem.weights > 0.0]).T
    theta = float(np.arctan2(np.hypot(x, y), z).max())
    return grown / max(1.0, 1.0 + float(p[10:14] @ theta ** np.array([2, 4, 6, 8])))


def _radial(corner: float, order: int) -> float:
    return min(_LARGEST, _AT_CORNER / corner ** (2 * order))
