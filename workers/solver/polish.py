# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
"""The last step: least squares from where a search ended, plain or robust."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
from typing import Final, NamedTuple

import numpy as np
import scipy  # its subpackages are loaded by their first use
from numpy.typing import NDArray

from apexcal.geometry.rotations import shortest_vector
from workers.geometry.projection import distances_px
from workers.solver.newton import Quadratic, newton, quadratic, saturated
from workers.solver.outcomes import Outcome
from workers.solver.problem import ASPECT, FitProblem
from workers.solver.residuals import predict, residuals_and_jacobian
from workers.solver.weighting import REWEIGHTED, roughly_whitened, whitened

Floats = NDArray[np.float64]
SQUARES: Final = "sum of squared pixel distances"
ROBUST: Final = "Geman-McClure loss of pixel distances"
MAX_EVALUATIONS: Final = 300
SATURATION_SIGMAS: Final = 4.0
"""Distance, in robust sigmas of the marks, at which a pair's loss is half of what it can ever be."""
MEDIAN_DISTANCE: Final = 1.1774100225154747
"""Median distance of unit Gaussian marks in the plane, sqrt(2 ln 2)."""
_SCALE_FLOOR_PX: Final = 0.1
_SCALE_ROUNDS: Final = 8
_ENDS: Final = 1e-12
_ON_THE_WAY: Final = 1e-5
"""Tolerances, as relative gains of a step: of the final descent, and of a descent that another one continues."""


@dataclass(frozen=True)
class Fit:
    """Parameters (D,) in the order of `problem.names`; mean and RMS distance in px; what was minimised.

    `outcome` says how the descent ended. `cost` is the minimum itself in px^2, priors and weights included, so that
    only fits of one problem under one whitening compare by it; `scale_px` the distance at which the robust loss is
    half saturated.
    """

    parameters: tuple[float, ...]
    mean_px: float
    rms_px: float
    minimised: str
    outcome: Outcome
    cost: float = 0.0
    scale_px: float | None = None


class _End(NamedTuple):
    """The end of a descent: p (D,), outcome, and scale of its loss; by a trust region also the minimum, px^2, and
    whether a pair's projection was forbidden on the way.
    """

    p: Floats
    outcome: Outcome
    scale_px: float | None
    cost: float = inf
    met_wall: bool = False


def polish(problem: FitProblem, start: Sequence[float] | Floats) -> Fit:
    """Least squares over the free parameters inside the problem's bounds, from `start` (D,).

    Trust region reflective (scipy.optimize.least_squares) with analytic derivatives. It minimises the weighted
    squared pixel distances plus the priors; where the problem's loss is `saturating`, the robust loss
    d^2 / (1 + d^2 / c^2) of the same distances (Geman and McClure 1987), c following from the median distance as
    long as that stays below `saturation_px`, and otherwise from the pairs nearer than that (`robust_sigma_px`).

    It descends straight on. If it meets forbidden projections, which are walls (from a far start they would stop it
    at once), it also descends over the continued formulas first, without walls, and keeps the lower end. With
    covariances this is done under rough weights. From its end it goes on as `refine` does.
    """
    p = np.clip(np.asarray(start, dtype=np.float64), *_walls_of(problem))
    rough = roughly_whitened(problem)
    if len(problem.free):
        p = (_robust(rough, p) if problem.loss == "saturating" else _descend_twice(rough, p, None)).p
    return refine(problem, p)


def refine(problem: FitProblem, start: Sequence[float] | Floats) -> Fit:
    """Return the minimum that `polish` finds, from the end (D,) of a fit to most of these pairs.

    It descends straight on, by steps of Newton as far as they lead down. With covariances it does so twice, each time
    under the weights that hold where it begins (iteratively reweighted).
    """
    p, here = np.clip(np.asarray(start, dtype=np.float64), *_walls_of(problem)), problem
    end = _end(problem, p, None, Outcome.NOTHING_FREE)
    for _ in range(0 if len(problem.free) == 0 else REWEIGHTED if problem.covariances is not None else 1):
        here = whitened(problem, end.p)
        if problem.loss == "saturating":
            end = _follow_scale(here, end._replace(scale_px=None))
        else:
            end = _descend_near(here, end.p, None)
    mean, rms = mean_and_rms(here, end.p)
    return Fit(
        parameters=tuple(end.p.tolist()),
        mean_px=mean,
        rms_px=rms,
        minimised=SQUARES if end.scale_px is None else ROBUST,
        outcome=end.outcome,
        cost=cost_of(here, end.p, end.scale_px),
        scale_px=end.scale_px,
    )


def robust_sigma_px(problem: FitProblem, p: Floats) -> float:
    """The typical noise per coordinate that the median distance shows, corrected for the parameters fitted.

    The median breaks down where half of the pairs are wrong. So where it says more than the problem's saturation
    allows, it is that of the pairs within `saturation_px`, and at most saturation_px / SATURATION_SIGMAS.
    """
    d = standard_distances(problem, p)[problem.weights > 0.0]
    sigma, most = _median_sigma(d, len(problem.free)), problem.saturation_px / SATURATION_SIGMAS
    if sigma <= most:
        return sigma
    near = d[d <= problem.saturation_px]
    return min(most, _median_sigma(near, len(problem.free))) if len(near) >= len(problem.free) else most


def _median_sigma(d: Floats, free: int) -> float:
    count = 2 * len(d)
    return max(_SCALE_FLOOR_PX, sqrt(count / max(count - free, 1)) * float(np.median(d)) / MEDIAN_DISTANCE)


def _median_scale(problem: FitProblem, p: Sequence[float] | Floats) -> float:
    d = standard_distances(problem, p)[problem.weights > 0.0]
    return SATURATION_SIGMAS * _median_sigma(d, len(problem.free))


def cost_of(problem: FitProblem, p: Sequence[float] | Floats, scale_px: float | None = None) -> float:
    """Return the polish's cost, px^2: squares, or the robust loss that is half saturated at scale_px."""
    residuals = weighted_residuals(problem, np.asarray(p, dtype=np.float64))[0]
    if scale_px is not None:
        residuals = saturated(residuals, None, 2 * len(problem.points), scale_px)[0]
    return float(residuals @ residuals)


def distances(problem: FitProblem, p: Sequence[float] | Floats) -> Floats:
    """Distance (N,) in px of every pair under parameters (D,); a forbidden projection counts its cost."""
    pixels, violation = predict(problem, np.asarray(p, dtype=np.float64))
    return distances_px(pixels, violation, problem.pixels, problem.diagonal_px)


def standard_distances(problem: FitProblem, p: Sequence[float] | Floats) -> Floats:
    """`distances` (N,) as they count in the fit: weighted, or whitened; in px of a typical pair."""
    if problem.whitening is None:
        return distances(problem, p) * np.sqrt(problem.weights)
    residuals = weighted_residuals(problem, np.asarray(p, dtype=np.float64))[0]
    pairs = residuals[: 2 * len(problem.points)].reshape(-1, 2)
    return np.hypot(pairs[:, 0], pairs[:, 1])


def mean_and_rms(problem: FitProblem, p: Sequence[float] | Floats) -> tuple[float, float]:
    """Weighted mean and root mean square of `distances`, in px."""
    d = distances(problem, p)
    total = float(np.sum(problem.weights))
    return float(np.sum(problem.weights * d)) / total, sqrt(float(np.sum(problem.weights * d * d)) / total)


def weighted_residuals(
    problem: FitProblem, p: Floats, local: bool = False, walls: bool = True
) -> tuple[Floats, Floats]:
    """Residuals and their Jacobian in the free parameters, rows weighted or whitened, one row more for each prior.

    Shapes (2 N + priors,) and (2 N + priors, free). The unit is the pixel: a prior's row is its standard score
    times the marks' sigma.
    """
    residuals, jacobian = residuals_and_jacobian(problem, p, local, walls)
    if problem.whitening is not None:
        residuals = np.einsum("nij,nj->ni", problem.whitening, residuals.reshape(-1, 2)).ravel()
        rows_of_pairs = np.matmul(problem.whitening, jacobian.reshape(-1, 2, len(p)))
        jacobian = rows_of_pairs.reshape(-1, len(p))
    root = np.sqrt(np.repeat(problem.weights, 2))
    rows, derivatives = [root * residuals], [root[:, None] * jacobian]
    for name, (mean, sigma) in problem.priors.items():
        strength = problem.noise_scale * problem.mark_sigma_px / sigma
        value, slope = _under_prior(problem, p, name)
        rows.append(np.array([strength * (value - mean)]))
        derivatives.append(strength * slope[None])
    return np.concatenate(rows), np.ascontiguousarray(np.concatenate(derivatives)[:, problem.free])


def _under_prior(problem: FitProblem, p: Floats, name: str) -> tuple[float, Floats]:
    """Return the quantity that a prior of that name holds, and its derivative (D,) by the parameters p (D,)."""
    slope = np.zeros(len(p))
    if name != ASPECT:
        index = problem.names.index(name)
        slope[index] = 1.0
        return float(p[index]), slope
    slope[6:8] = -p[7] / p[6] ** 2, 1.0 / p[6]
    return float(p[7] / p[6]), slope


def _robust(problem: FitProblem, p: Floats) -> _End:
    # From a far start the scale begins wide, and so sees every pair. That loses a good start where half of the pairs
    # are wrong: so where the median did not come down, also straight on at the saturation, and the lower end counts.
    wide, most = _median_scale(problem, p), problem.saturation_px
    end = _follow_scale(problem, _graduate(problem, _descend_twice(problem, p, wide)))
    if wide <= most or _median_scale(problem, end.p) <= most:
        return end
    near = _follow_scale(problem, _descend_twice(problem, p, most))
    scale = min(end.scale_px or inf, near.scale_px or inf)
    return min((near, end), key=lambda robust: cost_of(problem, robust.p, scale))


def _graduate(problem: FitProblem, end: _End) -> _End:
    """Return the end of graduated non-convexity (Blake and Zisserman 1987).

    If the median leaves the scale above the saturation, the scale is halved, each descent from the last one's end.
    """
    most = problem.saturation_px
    while (scale := end.scale_px or inf) > most and _median_scale(problem, end.p) > most:
        end = _descend(problem, end.p, max(most, 0.5 * scale))
    return end


def _follow_scale(problem: FitProblem, end: _End) -> _End:
    for _ in range(_SCALE_ROUNDS):
        scale = SATURATION_SIGMAS * robust_sigma_px(problem, end.p)
        if end.scale_px is not None and abs(scale - end.scale_px) <= 1e-3 * scale:
            break
        end = _descend_near(problem, end.p, scale)
    return end


def _descend_twice(problem: FitProblem, p: Floats, scale: float | None) -> _End:
    straight = _descend(problem, p, scale)
    if not straight.met_wall:
        return straight  # without walls it would go the same way
    around = _descend(problem, _descend(problem, p, scale, walls=False).p, scale)
    return straight if straight.cost <= around.cost else around


def _descend_near(problem: FitProblem, start: Floats, scale: float | None) -> _End:
    p, free = start.copy(), problem.free
    lower, upper = (end[free] for end in _walls_of(problem))

    def about(x: Floats) -> Quadratic:
        problem.stop.check()
        p[free] = x
        return quadratic(*weighted_residuals(problem, p), 2 * len(problem.points), scale)

    minimum = newton(about, start[free], lower, upper, MAX_EVALUATIONS)
    if minimum is None:
        return _descend(problem, start, scale, tolerance=_ENDS)
    p[free] = minimum
    return _end(problem, p, scale, Outcome.CONVERGED)


def _descend(
    problem: FitProblem, start: Floats, scale: float | None, walls: bool = True, tolerance: float = _ON_THE_WAY
) -> _End:
    p, free = start.copy(), problem.free
    lower, upper = (end[free] for end in _walls_of(problem))
    count = 2 * len(problem.points)

    at, evaluated = np.full(len(free), np.nan), (np.empty(0), np.empty((0, 0)))
    used, met_wall = problem.weights > 0.0, False

    def both(x: Floats) -> tuple[Floats, Floats]:
        nonlocal evaluated, met_wall
        # SciPy asks for the derivatives where it has just asked for the residuals.
        if not np.array_equal(at, x):
            problem.stop.check()
            at[:] = p[free] = x
            weighted = weighted_residuals(problem, p, walls=walls)
            # Forbidden projections have no derivatives.
            met_wall = met_wall or not np.all(np.any(weighted[1][:count].reshape(len(used), -1)[used], axis=1))
            evaluated = weighted if scale is None else saturated(*weighted, count, scale)
        return evaluated

    def residuals_at(x: Floats) -> Floats:
        return both(x)[0]

    def jacobian_at(x: Floats) -> Floats:
        return both(x)[1]

    # The solver wants a start strictly inside.
    margin = 1e-9 * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    solution = scipy.optimize.least_squares(
        residuals_at,
        np.clip(start[free], lower + margin, upper - margin),
        jac=jacobian_at,
        bounds=(lower, upper),
        method="trf",
        x_scale="jac",
        ftol=tolerance,
        xtol=_ENDS,
        gtol=_ENDS,
        max_nfev=MAX_EVALUATIONS,
    )
    p[free] = solution.x
    outcome = Outcome.CONVERGED if solution.status > 0 else Outcome.OUT_OF_STEPS
    return _end(problem, p, scale, outcome)._replace(cost=2.0 * float(solution.cost), met_wall=met_wall)


def _walls_of(problem: FitProblem) -> tuple[Floats, Floats]:
    lower, upper = problem.lower, problem.upper
    if problem.any_rotation:
        lower[:3], upper[:3] = -np.inf, np.inf
    return lower, upper


def _end(problem: FitProblem, p: Floats, scale: float | None, outcome: Outcome) -> _End:
    if problem.any_rotation:
        p[:3] = shortest_vector(p[:3])
    return _End(p, outcome, scale)
