"""The named schedules of the search, and the limits of their numbers."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import inf
from typing import Any, Final, Literal, get_args

from apexcal.documents.errors import DocumentError

PresetName = Literal["default", "paper", "toolbox"]


@dataclass(frozen=True)
class Schedule:
    """Algorithm 2's numbers. `scale` narrows the half-widths from iteration to iteration.

    It stops when `patience` iterations brought no relative decrease above `tolerance`, at `goal_px`, or after
    `max_iterations`; never by wall time.
    """

    slots: int = 4
    population: int = 800
    generations: int = 30
    scale: float = 0.7
    max_iterations: int = 60
    patience: int = 3
    tolerance: float = 1e-4
    goal_px: float | None = None


# Ours reaches the same optima as the paper's numbers with some 60 % of the evaluations, on simulated rigs and on the
# real board; four slots divide evenly among workers. Half-widths that shrink by 0.7, not 0.8, save a quarter of the
# time and lose nothing; by 0.5 they begin to (docs/decisions/0014).
PRESETS: Final[dict[PresetName, Schedule]] = {
    "default": Schedule(),
    "paper": Schedule(slots=5, scale=0.8, patience=5),
    "toolbox": Schedule(slots=20, population=2000, generations=50, max_iterations=1),
}

LIMITS: Final[dict[str, dict[str, Any]]] = {
    "slots": {"ge": 1, "le": 1000},
    "population": {"ge": 64, "le": 100_000},
    "generations": {"ge": 1, "le": 10_000},
    "scale": {"gt": 0, "le": 1},
    "max_iterations": {"ge": 1, "le": 1000},
    "patience": {"ge": 1, "le": 1000},
    "tolerance": {"ge": 0, "lt": 1},
    "goal_px": {"gt": 0},
}
"""What each number may be, in the words of pydantic's fields: ge and le with the end, gt and lt without."""
_WHOLE: Final = ("slots", "population", "generations", "max_iterations", "patience")
_WORDS: Final = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}


def schedule_of(preset: object, overrides: Mapping[str, Any]) -> Schedule:
    """The preset's schedule with single numbers replaced.

    Raises:
        DocumentError: ``unknown_preset``, ``bad_schedule``.
    """
    for name in get_args(PresetName):
        if preset == name:
            return check_schedule(_replaced(PRESETS[name], overrides))
    raise DocumentError(
        "unknown_preset", f"There is no preset named {preset!r}.", f"The presets are {', '.join(PRESETS)}."
    )


def _replaced(schedule: Schedule, overrides: Mapping[str, Any]) -> Schedule:
    known = sorted(field.name for field in fields(Schedule))
    unknown = [name for name in overrides if name not in known]
    if unknown:
        raise DocumentError("bad_schedule", f"`schedule` has no {unknown[0]!r}.", f"It has {', '.join(known)}.")
    try:
        numbers = {
            name: None if value is None else int(value) if name in _WHOLE else float(value)
            for name, value in overrides.items()
        }
    except (TypeError, ValueError) as error:
        raise DocumentError("bad_schedule", f"`schedule` holds something that is no number: {error}.") from error
    return replace(schedule, **numbers)


def check_schedule(schedule: Schedule) -> Schedule:
    """The schedule itself, if it can be run. Raises DocumentError ``bad_schedule``."""
    for name, limits in LIMITS.items():
        value = getattr(schedule, name)
        if value is None and name == "goal_px":
            continue
        if value == inf or not all(getattr(operator, how)(value, end) for how, end in limits.items()):
            wanted = " and ".join(f"{_WORDS[how]} {end}" for how, end in limits.items())
            raise DocumentError("bad_schedule", f"`{name}` is {value}.", f"It must be {wanted}.")
    return schedule
