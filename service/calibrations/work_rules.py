"""How much work may be asked for at once: what a request is predicted to cost, against what a farm can take."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any, NamedTuple

from apexcal.documents.camera_models import ModelName
from apexcal.documents.checks import figure
from apexcal.documents.schedules import Schedule
from service.platform.http.problems import Problem, unprocessable
from service.platform.jobs.bundles import RunCost, comparison_s
from service.platform.settings import get_settings

# How many times slower, or busier, a worker may be than the machine on which the costs were measured.
SLOWER = 4.0
# Other fleets wait for a slot that runs. The dearest model with the preset `toolbox` on 100,000 pairs, the most that
# a set may have, comes to 10 s.
LONGEST_SLOT_S = 30.0
# Rows that a calibration's slots leave: 465 bytes each, and 14 s a million when they are summed up at the end, in
# which SQLite lets nobody else write (a busy 2-core machine). Sixteen cameras, three models and five folds come to
# 69,120 with the default schedule at most.
MOST_SLOTS = 200_000
# Pairs over all runs of a calibration. Each leaves a residual in its run's result, all of which are read at the end:
# 21 bytes and 2 s a million. The most pairs that a set may have, three models and five folds come to 1.8 million.
MOST_FITTED_PAIRS = 2_000_000
_HOUR_S = 3600.0


class FitWork(NamedTuple):
    """A model on a camera's pairs: its runs (with and without held-out blocks) and what each costs."""

    camera: str
    model: ModelName
    pairs: int
    runs: int
    cost: RunCost


def predicted_s(fits: Sequence[FitWork]) -> float:
    """Processor seconds of a calibration of these, the comparison of its cameras included."""
    return _comparison_s(fits) + sum(fit.runs * fit.cost.seconds for fit in fits)


def _comparison_s(fits: Sequence[FitWork]) -> float:
    pairs = {fit.camera: fit.pairs for fit in fits}
    return comparison_s(len(pairs), max(pairs.values(), default=0))


def check_work(fits: Sequence[FitWork], size: Schedule) -> None:
    """Refuse a calibration that a farm cannot take.

    Raises:
        Problem: 422 ``work_too_long`` where one slot or another piece is too long for whoever waits behind it,
            ``calibration_too_large`` where the whole is too much.
    """
    for fit in fits:
        _check_run(fit, size)
    # By whoever ends the last fit, in one piece.
    longest_end_s = max(fit.cost.finish_s for fit in fits)
    check_job("the comparison of the cameras after the last fit", longest_end_s + _comparison_s(fits), _PAIRS)
    seconds, hours = predicted_s(fits), get_settings().calibration_hours
    if seconds > hours * _HOUR_S:
        raise _too_large(
            f"is predicted to take up to {_hours(seconds)}, and one may take {_hours(hours * _HOUR_S)}",
            "Lower schedule.slots, schedule.max_iterations, schedule.population or schedule.generations; or ask for "
            "fewer models or folds, with fewer pairs.",
            predicted_seconds=round(seconds),
            limit_seconds=round(hours * _HOUR_S),
        )
    slots = sum(fit.runs * fit.cost.slots for fit in fits)
    if slots > MOST_SLOTS:
        raise _too_large(
            f"may run {slots:,} slots, and one may run {MOST_SLOTS:,}",
            "Lower schedule.slots or schedule.max_iterations, or ask for fewer models or folds.",
        )
    pairs = sum(fit.runs * fit.pairs for fit in fits)
    if pairs > MOST_FITTED_PAIRS:
        raise _too_large(
            f"fits {pairs:,} pairs over all its runs, and one may fit {MOST_FITTED_PAIRS:,}",
            "Ask for fewer models, folds or cameras at once, or give fewer pairs.",
        )


def check_job(what: str, seconds: float, hint: str, at_most_s: float = inf) -> None:
    """Refuse a piece of work that a slow worker could not end within a task's time. Raises 422 ``work_too_long``."""
    limit = min(at_most_s, get_settings().task_limit_s / SLOWER)
    if seconds > limit:
        raise unprocessable(
            "work_too_long",
            f"{what[0].upper()}{what[1:]} is predicted to take {seconds:,.0f} s in one piece, and a piece may take "
            f"{limit:,.0f} s.",
            hint,
            predicted_seconds=round(seconds),
            limit_seconds=round(limit),
        )


def check_fleet_total(seconds: float) -> None:
    """Refuse a fleet request whose calibrations together are too much. Raises 422 ``fleet_request_too_large``."""
    limit = get_settings().fleet_request_hours * _HOUR_S
    if seconds > limit:
        raise unprocessable(
            "fleet_request_too_large",
            f"This request is predicted to take more than {_hours(limit)}, which is the most for one request.",
            "Ask in several requests: narrow the filter, ask for fewer models or folds, or for a smaller schedule.",
            limit_seconds=round(limit),
        )


def _check_run(fit: FitWork, size: Schedule) -> None:
    of = f"{fit.model} on {fit.pairs:,} pairs" + (f" of {fit.camera}" if fit.camera else "")
    check_job(
        f"one slot of {of} (population {size.population:,}, {size.generations:,} generations)",
        fit.cost.slot_s,
        "Lower schedule.population or schedule.generations, or give fewer pairs. More slots and iterations search as "
        "much in shorter pieces.",
        LONGEST_SLOT_S,
    )
    check_job(f"the last step of {of}", fit.cost.finish_s, _PAIRS)


_PAIRS = "Give fewer pairs."


def _too_large(what: str, hint: str, **fields: Any) -> Problem:
    return unprocessable("calibration_too_large", f"This calibration {what}.", hint, **fields)


def _hours(seconds: float) -> str:
    hours = seconds / _HOUR_S
    return f"{hours:,.0f} processor hours" if hours >= 10.0 else f"{figure(hours)} processor hours"
