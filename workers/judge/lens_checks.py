"""Checks of the lens: whether its model fits, whether it lies inside its bounds, and whether priors and statements
about it hold.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.checks import USE_LIMIT_PX, USE_LIMIT_RAD, Check, CheckTopic, figure
from apexcal.documents.results import FitResult
from workers.judge.effects import moved_over_limit
from workers.judge.residual_patterns import pattern_test
from workers.judge.topics import LOOK_RATE, graded
from workers.solver.estimate import Estimate
from workers.solver.residuals import predict, transform_of

Floats = NDArray[np.float64]
_LENS: Final = CheckTopic("lens_model", "Lens model")
_BOUNDS: Final = CheckTopic("bounds", "Bounds of the parameters")
_PRIORS: Final = CheckTopic("priors", "Priors")
_STATED: Final = CheckTopic("stated_lens", "Stated lens")
# Radial patterns up to the seventh power of the distance from the centre: the lens models' own terms go that far.
_POWERS: Final = (1, 2, 3, 4, 5, 6, 7)
_NOTHING_LEFT: Final = 1e-6  # of a prior's variance, as far as rounding goes: the pairs say nothing of the parameter


def lens_model(estimate: Estimate) -> Check:
    """Whether residuals follow a radial or decentring pattern, as those under a lens model that does not fit do."""
    problem, p = estimate.holding, estimate.held_at
    columns = np.nan_to_num(lens_patterns(estimate))
    test = pattern_test(estimate, columns) if np.any(columns) else None
    if test is None:
        return _LENS.passes("The fit states no errors to compare the residuals' pattern with.")
    used = problem.weights > 0.0
    size = np.hypot(*test.pattern[used].T)
    largest_px = float(np.quantile(size, 0.99))
    inside = transform_of(problem, p).apply(problem.points[used])
    angles = np.degrees(np.arctan2(np.hypot(inside[:, 0], inside[:, 1]), inside[:, 2]))
    angle = float(angles[int(np.argmin(np.abs(size - largest_px)))])
    focal_px = float(np.sqrt(p[6] * p[7]))
    verdict = graded(test.probability, largest_px, max(USE_LIMIT_PX, USE_LIMIT_RAD * focal_px))
    model = estimate.fitted.model
    sentence = (
        f"Residuals follow no pattern of a lens beyond chance; {model} fits."
        if verdict == "pass"
        else f"The lens model {model} does not fit this lens: residuals follow a pattern of up to "
        f"{figure(largest_px)} px, at {angle:.0f} degrees from the axis."
    )
    return _LENS.fails(
        verdict,
        sentence,
        "Calibrate with the other models and compare them.",
        probability=test.probability,
        pattern_px=largest_px,
        pattern_at_deg=angle,
        noise_px=estimate.spread.sigma_px,
    )


def lens_patterns(estimate: Estimate) -> Floats:
    """(N, 2, 9) shifts by radial terms and by the two of decentring (Conrady 1919), about 1 px at the corner."""
    problem = estimate.holding
    pixels, violation = predict(problem, estimate.held_at)
    away = np.where((violation > 0.0)[:, None], 0.0, pixels - estimate.held_at[8:10]) / (0.5 * problem.diagonal_px)
    x, y = away.T
    square = x * x + y * y
    radial = [np.sqrt(square) ** (power - 1) for power in _POWERS]
    along = away[:, :, None] * np.stack(radial, axis=1)[:, None, :]
    decentred = [[square + 2.0 * x * x, 2.0 * x * y], [2.0 * x * y, square + 2.0 * y * y]]
    return np.concatenate([along, np.array(decentred).T], axis=2)


def bounds(result: FitResult) -> Check:
    """Whether a free parameter lies on an end of its bounds."""
    names = ", ".join(result.at_bounds)
    return _BOUNDS.fails(
        "stop" if names else "pass",
        f"The optimum lies on the edge of the bounds of {names}."
        if names
        else "No parameter lies on the edge of its bounds.",
        "Widen the bounds, or lock what is known.",
        parameters=float(len(result.at_bounds)),
    )


def priors(estimate: Estimate) -> Check:
    """Whether what the request expects of parameters agrees with the pairs.

    The distance between the means of prior and posterior has the prior's variance less that which the fit itself
    counts on, and what pairs share besides. A prior that is off matters if points of use move without it.
    """
    problem, p = estimate.fitted, estimate.parameters
    names = [name for name in problem.priors if name not in estimate.weak and name in estimate.spread.names]
    if not names or estimate.errors is None:
        return _PRIORS.passes("The request states no priors." if not names else "The pairs leave parameters open.")
    scale = estimate.errors.scale
    counted_on = estimate.errors.inverse() * np.outer(scale, scale)
    stated = np.diag(estimate.errors.covariance())
    worst, most, step = names[0], 0.0, np.zeros(len(scale))
    for name in names:
        row = estimate.spread.names.index(name)
        mean, sigma = problem.priors[name]
        left = sigma**2 - float(counted_on[row, row])
        if left < _NOTHING_LEFT * sigma**2:
            continue  # The pairs say nothing of it.
        off = float(p[problem.names.index(name)]) - mean
        deviations = abs(off) / float(np.sqrt(left + max(float(stated[row] - counted_on[row, row]), 0.0)))
        if deviations > most:
            worst, most, step = name, deviations, counted_on[:, row] * off / left
    probability = min(len(names) * 2.0 * float(special.ndtr(-most)), 1.0)
    effect = moved_over_limit(estimate, step)
    verdict = graded(probability, effect, 1.0)
    said = f"{worst} lies {most:.1f} deviations from its prior"
    moves = f"without it points at 5 to 50 m move by {figure(effect)} times what use allows"
    return _PRIORS.fails(
        verdict,
        f"{said}; {moves}." if probability < LOOK_RATE else f"The pairs agree with the priors: {said} at most.",
        f"Is the prior of {worst} right? A clock that is off may look like a wrong prior. Or calibrate without it.",
        deviations=most,
        probability=probability,
        moved_over_limit=effect,
    )


def stated_lens(result: FitResult) -> Check:
    """Whether the pairs bear out the lens that the recording or a file states.

    If they do not, a result that rests on it should not be used. One with a lens of its own holds with that lens.
    """
    stated = result.stated_lens
    if result.unused_lens:
        return _STATED.fails(
            "look",
            f"A lens is stated and not used: {result.unused_lens}.",
            "The mount holds with the fitted lens only: load that one on the vehicle, or calibrate the lens as "
            "plumb_bob, rational_polynomial or equidistant, and state it.",
        )
    if not stated:
        return _STATED.passes("Neither the recording nor a file states a lens.")
    fitted = result.lens == "fitted"
    return _STATED.fails(
        "pass" if stated.explains is not False else "look" if fitted else "stop",
        stated.sentence,
        "Load the fitted lens on the vehicle: it projects through the stated one."
        if fitted
        else "Check whose lens was stated, or calibrate with a free lens (--intrinsics-as free).",
        rms_px=stated.rms_px,
        free_lens_rms_px=stated.free_lens_rms_px,
    )
