"""Checks of the fit as a whole: how it ended, other optima, halves of the pairs, and errors that pairs share."""

from __future__ import annotations

from typing import Final

import numpy as np

from apexcal.documents.checks import Check, CheckTopic, figure
from apexcal.documents.precision import Halves
from apexcal.documents.results import FitResult, Status
from workers.judge.precision_checks import stated_over_limit
from workers.judge.topics import HALF, over_use
from workers.solver.estimate import Estimate
from workers.solver.halves import too_small

_FIT: Final = CheckTopic("fit", "Fit")
_OPTIMA: Final = CheckTopic("optima", "Other optima")
_HALVES: Final = CheckTopic("halves", "Halves of the pairs")
_SHARED: Final = CheckTopic("shared_errors", "Errors that pairs share")
_TURN_LIMIT_RAD: Final = 1.5e-3
_MOSTLY_SHARED: Final = 2.0**0.5  # of a stated deviation: from here on half of its square is of shared errors
_MORE: Final = "Mark corners at other heights, distances and image regions, lock what is known"
_REMEDIES: Final[dict[Status, str]] = {
    "ok": "",
    "unfinished": "Calibrate again without stopping it.",
    "not_converged": f"{_MORE}, or run more slots.",
    "not_determined": f"{_MORE}, and check the nominal rotation and its range.",
    "not_explained": "Check what is locked, the order and signs of u and v, the image size, and that frames and "
    "marks are of this camera.",
}
# Twice the log likelihood ratio that independent errors exceed in one of thousand cases, by the number of components.
# Each component is zero half of the time (Self and Liang 1987).
_BEYOND_CHANCE: Final = {1: 9.55, 2: 11.76}


def fit(result: FitResult) -> Check:
    """Whether the fit ended well."""
    return _FIT.fails("pass" if result.status == "ok" else "stop", result.message, _REMEDIES[result.status])


def optima(result: FitResult) -> Check:
    """Whether slots, search and baselines ended in one place."""
    others = result.several_optima
    return _OPTIMA.fails(
        "stop" if others else "pass",
        " ".join(others) or "Search, slots and baselines found no other optimum.",
        "Bound or lock what is known of mount and lens, mark corners at other places, look for marks "
        "of another corner or frame, or run more slots.",
        others=float(len(others)),
    )


def halves(estimate: Estimate, result: FitResult) -> Check:
    """Whether fits of two halves of the pairs agree within what is stated.

    A difference beyond chance stops a result if it is larger than its use allows, and is worth a look from half of
    that. A smaller one widens what the result states of points (`prediction`).
    """
    compared = result.halves
    if not compared:
        return _HALVES.not_checked("The pairs are too few for two fits.", "Mark more corners.")
    figures: dict[str, float | None] = {}
    for comparison in compared:
        figures |= {
            f"{comparison.split}_ratio": comparison.ratio,
            f"{comparison.split}_field_px": comparison.field_px,
        }
        figures |= {"turned_deg": comparison.turned_deg} if comparison.turned_deg is not None else {}
    apart = [comparison for comparison in compared if not comparison.holds]
    if not apart:
        ratios = " and ".join(f"{comparison.ratio:.2f}" for comparison in compared)
        return _HALVES.passes(
            f"Two halves of the pairs give results {ratios} times the stated error apart; 1 is expected.", **figures
        )
    focal_px = float(np.sqrt(estimate.parameters[6] * estimate.parameters[7]))
    worst = max(max(_off(comparison, focal_px), _turned(comparison)) for comparison in apart)
    return _HALVES.fails(
        "stop" if worst > 1.0 else "look" if worst > HALF else "pass",
        " ".join(too_small(apart, estimate.holding)),
        "Check the lens model, the clocks and the marks, and whether the mount moved; then calibrate from one half.",
        **figures,
    )


def _off(comparison: Halves, focal_px: float) -> float:
    """Return the difference of the marks' projections over the limit of use; 0 within chance."""
    return over_use(comparison.field_px, focal_px) if comparison.field_ratio > comparison.field_limit else 0.0


def _turned(comparison: Halves) -> float:
    if comparison.turned_deg is None or comparison.turned_ratio is None or comparison.turned_limit is None:
        return 0.0
    return (
        float(np.radians(comparison.turned_deg)) / _TURN_LIMIT_RAD
        if comparison.turned_ratio > comparison.turned_limit
        else 0.0
    )


def shared_errors(estimate: Estimate, result: FitResult) -> Check:
    """Whether pairs of one pose, or near in time, err together by more than each errs alone.

    The stated deviations count what pairs share. It is a doubt only where that is most of what is stated, because few
    blocks tell how large it is, and twice as much would exceed what use allows.
    """
    shared = result.shared_errors
    if not shared:
        return _SHARED.not_checked(
            "The pairs state neither poses nor times, or are too few.", "Mark a walk, or name the poses of pairs."
        )
    over_time, own_px = shared.over_time, shared.noise_px
    grave = shared.evidence > _BEYOND_CHANCE[len(shared.deviations)]
    grave &= estimate.spread.sigma_px**2 > 2.0 * own_px**2
    if over_time:
        grave |= over_time.evidence > _BEYOND_CHANCE[1] and over_time.shift_px > own_px
    grave &= shared.widening > _MOSTLY_SHARED or not shared.counted
    grave = grave and (estimate.errors is None or stated_over_limit(estimate, result)[0] > HALF)
    sizes = " and ".join(_size(*deviation) for deviation in shared.deviations.items() if deviation[1] > 0.0)
    blocks = "group" if shared.by == "group" else "stretch of the walk"
    stretches = f"; groups near in time by {figure(over_time.shift_px)} px" if over_time else ""
    sentence = (
        f"Pairs of one {blocks} have alike errors ({sizes}{stretches}). The stated errors "
        f"{'include' if shared.counted else 'leave out'} this{_widened(shared.widening)}."
        if sizes
        else "Pairs of one pose, or near in time, err independently."
    )
    return _SHARED.fails(
        "look" if grave else "pass",
        sentence,
        "Check the clocks, the board and whether the camera moved; more poses help, more pairs of one do not.",
        evidence=shared.evidence,
        widening=shared.widening,
        noise_px=own_px,
        **shared.deviations,
    )


def _widened(times: float) -> str:
    return f": they are {times:.2f} times as large with it" if f"{times:.2f}" != "1.00" else ", which changes nothing"


def _size(name: str, deviation: float) -> str:
    if name == "offset_m":
        return f"{figure(1e3 * deviation)} mm"
    return f"{figure(deviation)} {'px' if name == 'shift_px' else 'degrees'}"
