"""All checks that one fit to all pairs of a camera shows, made where the fit is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from apexcal.documents.checks import Check
from apexcal.documents.results import FitResult
from workers.judge.agreement_checks import fit, halves, optima, shared_errors
from workers.judge.causes import find_causes
from workers.judge.lens_checks import bounds, lens_model, priors, stated_lens
from workers.judge.pair_checks import coverage, noise, number_of_pairs, outside, wrong_pairs
from workers.judge.people_check import people
from workers.judge.precision_checks import mount_alone, precision
from workers.judge.time_checks import clock, rolling_shutter
from workers.solver.estimate import Estimate, estimate


def checks_of_fit(
    fit_estimate: Estimate, result: FitResult, *, pairs: Mapping[str, Sequence[Any]] | None = None
) -> list[Check]:
    """Return the checks of a fit, the gravest kinds first.

    fit_estimate: the estimate of the fit; result: what it became; pairs: the columns of its set. Wrong marks
    have a check of their own. All others look at the pairs that belong.
    """
    belonging = without_outliers(fit_estimate)
    causes = find_causes(belonging)
    return [
        fit(result),
        optima(result),
        wrong_pairs(fit_estimate, result),
        outside(belonging.holding, pairs or {}),
        number_of_pairs(belonging, pairs or {}),
        coverage(belonging.holding, result, pairs or {}),
        noise(belonging, result, pairs or {}),
        people(result, pairs or {}),
        lens_model(belonging, causes),
        bounds(result),
        priors(belonging, causes),
        stated_lens(result, causes),
        clock(causes, result),
        rolling_shutter(causes, result),
        shared_errors(belonging, result),
        halves(belonging, result),
        precision(fit_estimate, result, pairs or {}),
        mount_alone(result),
    ]


def without_outliers(fit_estimate: Estimate) -> Estimate:
    """Return the estimate of the pairs that belong: itself, or if the fit keeps others, that without them."""
    if not fit_estimate.outliers or fit_estimate.fitted.outliers == "exclude":
        return fit_estimate
    return estimate(replace(fit_estimate.fitted, outliers="exclude"), fit_estimate.held_at)
