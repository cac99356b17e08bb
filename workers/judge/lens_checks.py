"""Checks of the lens: whether its model fits, whether it lies inside its bounds, and whether priors and statements
about it hold.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from scipy import special

from apexcal.documents.checks import Check, CheckTopic, CheckVerdict, figure
from apexcal.documents.results import FitResult
from workers.judge.causes import CLOCK, LENS, SHUTTER, Finding
from workers.judge.effects import Effect, PointsOfUse
from workers.judge.topics import LOOK_RATE, graded
from workers.solver.error_model import weighed
from workers.solver.estimate import Estimate
from workers.solver.residuals import transform_of
from workers.solver.stated_lens import lens_origin
from workers.solver.weighting import whitened

_LENS: Final = CheckTopic("lens_model", "Lens model")
_BOUNDS: Final = CheckTopic("bounds", "Bounds of the parameters")
_PRIORS: Final = CheckTopic("priors", "Priors")
_STATED: Final = CheckTopic("stated_lens", "Stated lens")
_FREE: Final = "If not, calibrate with a free one (--intrinsics-as free)."
_NOTHING_LEFT: Final = 1e-6  # of a prior's variance, as far as rounding goes: the pairs say nothing of the parameter


def lens_model(estimate: Estimate, causes: Mapping[str, Finding]) -> Check:
    """Whether residuals follow a radial or decentring pattern, as they do if the lens model does not fit."""
    problem, p = estimate.holding, estimate.held_at
    finding = causes.get(LENS)
    if finding is None:
        return _LENS.not_checked(
            "The fit states no errors to compare the residuals' pattern with.", "Mark more corners."
        )
    test, effect = finding.test, finding.effect
    used = problem.weights > 0.0
    size = np.hypot(*test.pattern[used].T)
    largest_px = float(np.quantile(size, 0.99))
    inside = transform_of(problem, p).apply(problem.points[used])
    angles = np.degrees(np.arctan2(np.hypot(inside[:, 0], inside[:, 1]), inside[:, 2]))
    angle = float(angles[int(np.argmin(np.abs(size - largest_px)))])
    is_stated = lens_origin(estimate.fitted) == "stated"
    what = "stated lens" if is_stated else f"lens model {estimate.fitted.model}"
    return _LENS.fails(
        _lens_verdict(finding),
        f"The {what} does not fit {'these pairs' if is_stated else 'this lens'}: points at 5 to 50 m are off by "
        f"{figure(effect.estimate)} times the limit. Residuals have a pattern of up to {figure(largest_px)} px "
        f"{angle:.0f} degrees off axis."
        if finding.is_named
        else f"The {what} fits: the residuals have no pattern beyond chance.",
        f"Is it the lens of images like these: of this size, raw or rectified? {_FREE}"
        if is_stated
        else "Does another model fit better? Calibrate with the other models and compare them.",
        probability=test.probability,
        pattern_px=largest_px,
        pattern_at_deg=angle,
        noise_px=estimate.spread.sigma_px,
        over_limit=effect.estimate,
        at_least=effect.at_least,
    )


def _lens_verdict(finding: Finding | None) -> CheckVerdict:
    """Return what a pattern of the residuals says of the lens, if no rival explains more."""
    return graded(finding.test.probability, finding.effect) if finding and finding.is_named else "pass"


def bounds(result: FitResult) -> Check:
    """Whether a free parameter lies on an end of its bounds."""
    names = ", ".join(result.at_bounds)
    return _BOUNDS.fails(
        "stop" if names else "pass",
        f"The result lies on the edge of the bounds of {names}."
        if names
        else "No parameter lies on the edge of its bounds.",
        "Widen the bounds, or lock what is known.",
        parameters=float(len(result.at_bounds)),
    )


class PriorGap(NamedTuple):
    """The prior that the pairs contradict most: by how many deviations, how often chance does, and what it does."""

    name: str
    deviations: float
    probability: float
    effect: Effect


def worst_prior(estimate: Estimate, causes: Mapping[str, Finding]) -> PriorGap | None:
    """Compare the request's priors with the pairs; a clock or shutter that is a named cause is estimated beside them.

    The distance between the means of prior and posterior has the prior's variance less the posterior's by independent
    errors, plus what errors common to the pairs add. A prior that is off matters if points of use move without it.
    None if there is no prior, or the pairs leave parameters open.
    """
    problem, errors = estimate.fitted, estimate.errors
    names = _prior_names(estimate)
    if not names or errors is None:
        return None
    free, p = len(errors.scale), np.array(estimate.parameters)
    rivals = [causes[name] for name in (CLOCK, SHUTTER) if name in causes and causes[name].is_named]
    if rivals:
        columns = np.concatenate([each.columns for each in rivals], axis=2)
        whitened_pairs = whitened(estimate.holding, estimate.held_at)
        errors = errors.without("clock_ms").with_columns(weighed(whitened_pairs, columns))
        p[problem.free] += errors.step()[:free]
    counted_on = errors.inverse() * np.outer(errors.scale, errors.scale)
    stated = np.diag(errors.covariance())
    worst, most, off, variance = names[0], 0.0, 0.0, 1.0
    step = np.zeros(free)
    for name in names:
        row = estimate.spread.names.index(name)
        mean, sigma = problem.priors[name]
        left = sigma**2 - float(counted_on[row, row])
        if left < _NOTHING_LEFT * sigma**2:
            continue  # The pairs say nothing of it.
        total = left + max(float(stated[row] - counted_on[row, row]), 0.0)
        apart = float(p[problem.names.index(name)]) - mean
        if abs(apart) / np.sqrt(total) > most:
            worst, most, off, variance = name, abs(apart) / float(np.sqrt(total)), apart, total
            step = counted_on[:free, row] / left
    probability = min(len(names) * 2.0 * float(special.ndtr(-most)), 1.0)
    points = PointsOfUse(estimate)
    effect = points.effect(points.by_parameters @ step[:, None], np.array([off]), np.array([[variance]]))
    return PriorGap(worst, most, probability, effect)


def _prior_names(estimate: Estimate) -> list[str]:
    """The request's own priors, without the weak ones."""
    return [name for name in estimate.fitted.priors if name not in estimate.weak and name in estimate.spread.names]


def priors(estimate: Estimate, causes: Mapping[str, Finding]) -> Check:
    """Whether what the request expects of parameters agrees with the pairs."""
    if not _prior_names(estimate):
        return _PRIORS.passes("The request states no priors.")
    gap = worst_prior(estimate, causes)
    if gap is None:
        return _PRIORS.not_checked("The pairs do not determine all parameters.", "Mark more corners.")
    worst, effect = gap.name, gap.effect
    return _PRIORS.fails(
        graded(gap.probability, effect),
        f"The pairs contradict the prior of {worst}: without it points at 5 to 50 m move by "
        f"{figure(effect.estimate)} times the limit. The value lies {gap.deviations:.1f} deviations from the prior."
        if gap.probability < LOOK_RATE
        else f"The pairs agree with the priors; {worst} is farthest off, by {gap.deviations:.1f} deviations.",
        f"Is the prior of {worst} right? Calibrate without it, and compare held-out errors.",
        deviations=gap.deviations,
        probability=gap.probability,
        over_limit=effect.estimate,
        at_least=effect.at_least,
    )


def stated_lens(result: FitResult, causes: Mapping[str, Finding]) -> Check:
    """Whether the pairs bear out the lens that the recording or a file states.

    If the pairs do not, a result with the stated lens should not be used; one with a fitted lens holds with that one.
    If wrong times explain the residuals better than another lens does, they are mended first.
    """
    stated = result.stated_lens
    if result.unused_lens:
        return _STATED.fails(
            "look",
            f"The stated lens is not used: {result.unused_lens}.",
            "The mount holds with the fitted lens only: load that one on the vehicle, or calibrate the lens as "
            "plumb_bob, rational_polynomial or equidistant, and state it.",
        )
    if not stated:
        return _STATED.not_checked(
            "Neither the recording nor a file states a lens.", "State the camera's lens, by CameraInfo or a file."
        )
    if stated.explains is None:
        return _STATED.not_checked(stated.sentence, "Mark more corners.", rms_px=stated.rms_px)
    of_time = [name for name in (CLOCK, SHUTTER) if name in causes and causes[name].is_named]
    if not stated.explains and of_time and not causes[LENS].is_named:
        return _STATED.not_checked(
            "Wrong times explain the residuals better than a wrong lens does.",
            "Correct the times, and calibrate again.",
            rms_px=stated.rms_px,
            free_lens_rms_px=stated.free_lens_rms_px,
        )
    if stated.explains and result.lens == "stated" and _lens_verdict(causes.get(LENS)) != "pass":
        return _STATED.not_checked(
            "The residuals show another lens. These pairs do not tell it well enough to compare the two.",
            f"Is it this camera's lens? {_FREE}",
            rms_px=stated.rms_px,
            free_lens_rms_px=stated.free_lens_rms_px,
        )
    fitted = result.lens == "fitted"
    return _STATED.fails(
        "pass" if stated.explains else "look" if fitted else "stop",
        stated.sentence,
        "Does the vehicle project through the stated lens? Then load the fitted one on it."
        if fitted
        else f"Is it this camera's lens? {_FREE}",
        rms_px=stated.rms_px,
        free_lens_rms_px=stated.free_lens_rms_px,
    )
