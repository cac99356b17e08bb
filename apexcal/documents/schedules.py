"""The presets of a fit: the form of its search, how it treats its pairs, its schedule and the limits of that."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import inf
from typing import Any, Final, Literal

from apexcal.documents.bounds import BoundsPreset
from apexcal.documents.camera_models import SearchForm
from apexcal.documents.errors import DocumentError, chosen
from apexcal.documents.rules import Loss, OutlierRule

PresetName = Literal["default", "paper", "toolbox"]


@dataclass(frozen=True)
class Schedule:
    """Algorithm 2's numbers. `scale` narrows the half-widths from iteration to iteration.

    It stops when `patience` iterations brought no relative decrease above `tolerance`, at `goal_px`, or after
    `max_iterations`; never by wall time. With `agreeing` above 0 each slot's best is polished, and it also stops when
    so many slots ended at the lowest loss, within `tolerance` of it.
    """

    slots: int = 4
    population: int = 800
    generations: int = 30
    scale: float = 0.7
    max_iterations: int = 60
    patience: int = 3
    tolerance: float = 1e-4
    goal_px: float | None = None
    agreeing: int = 0


@dataclass(frozen=True)
class Preset:
    """What a request means where it names nothing else.

    By default wrong marks do no harm: the loss of the search saturates, pairs that do not belong are left out, and
    the others are fitted by least squares (decision 0089). ``weak_priors``: whether weak priors may hold distortion
    of which the request says nothing.
    """

    schedule: Schedule
    search: SearchForm = "rotation_vector"
    bounds: BoundsPreset = "image-size"
    loss: Loss = "saturating"
    outliers: OutlierRule = "exclude"
    weak_priors: bool = True


# Two slots whose polished ends agree are enough (docs/when-the-ga-helps.md). Half-widths that shrink by 0.7, not 0.8,
# save a quarter of the time and lose nothing; by 0.5 they begin to (docs/decisions/0016).
PRESETS: Final[dict[PresetName, Preset]] = {
    "default": Preset(Schedule(slots=2, agreeing=2)),
    "paper": Preset(Schedule(slots=5, scale=0.8, patience=5), "euler", "paper-table-1", "mean", "keep", False),
    "toolbox": Preset(Schedule(slots=20, population=2000, generations=50, max_iterations=1)),
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


def parse_preset(name: object) -> Preset:
    """The preset of that name. Raises DocumentError ``unknown_preset``."""
    return PRESETS[chosen(name, PRESETS, "preset")]


def schedule_of(preset: Preset, overrides: Mapping[str, Any]) -> Schedule:
    """The preset's schedule with single numbers replaced. Raises DocumentError ``bad_schedule``.

    Whoever replaces a number asks for Algorithm 2, whose slots narrow their bounds and need not agree.
    """
    narrowing = Schedule() if overrides and preset.schedule.agreeing else preset.schedule
    return check_schedule(_replaced(narrowing, overrides))


def _replaced(schedule: Schedule, overrides: Mapping[str, Any]) -> Schedule:
    names = sorted(field.name for field in fields(Schedule))
    unknown = [name for name in overrides if name not in names]
    if unknown:
        raise DocumentError("bad_schedule", f"`schedule` has no {unknown[0]!r}.", f"It has {', '.join(names)}.")
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
            range_words = " and ".join(f"{_WORDS[how]} {end}" for how, end in limits.items())
            raise DocumentError("bad_schedule", f"`{name}` is {value}.", f"It must be {range_words}.")
    return schedule
