"""The presets of a fit: form of the search, treatment of pairs, schedule; and the limits of a schedule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Final, Literal

from pydantic import ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass as checked

from apexcal.documents.base import first_fault
from apexcal.documents.bounds import BoundsPreset
from apexcal.documents.camera_models import SearchForm
from apexcal.documents.errors import DocumentError, chosen
from apexcal.documents.rules import Loss, OutlierRule

PresetName = Literal["default", "paper", "toolbox"]

Slots = Annotated[int, Field(ge=1, le=1000)]
Population = Annotated[int, Field(ge=64, le=100_000)]
Generations = Annotated[int, Field(ge=1, le=10_000)]
Scale = Annotated[float, Field(gt=0, le=1)]
Iterations = Annotated[int, Field(ge=1, le=1000)]
Tolerance = Annotated[float, Field(ge=0, lt=1)]
Goal = Annotated[float, Field(gt=0)]


@checked(frozen=True, config=ConfigDict(extra="forbid", allow_inf_nan=False))
class Schedule:
    """Algorithm 2's numbers. `scale` narrows the half-widths from iteration to iteration.

    The search stops when `patience` iterations brought no relative decrease above `tolerance`, at `goal_px`, or after
    `max_iterations`; never by wall time. With `agreeing` above 0 each slot's best is polished, and the search also
    stops when `agreeing` slots ended within `tolerance` of the lowest loss. Raises ValidationError for numbers beyond
    their limits.
    """

    slots: Slots = 4
    population: Population = 800
    generations: Generations = 30
    scale: Scale = 0.7
    max_iterations: Iterations = 60
    patience: Iterations = 3
    tolerance: Tolerance = 1e-4
    goal_px: Goal | None = None
    agreeing: int = 0


@dataclass(frozen=True)
class Preset:
    """Values for everything that a request leaves open.

    By default wrong marks do no harm: the loss of the search saturates, pairs that do not belong are left out, and
    the others are fitted by least squares (decision 0089). ``weak_priors``: whether weak priors may hold distortion
    and aspect if the request says nothing of them.
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


def parse_preset(name: object) -> Preset:
    """Return the preset of that name. Raise DocumentError ``unknown_preset``."""
    return PRESETS[chosen(name, PRESETS, "preset")]


def schedule_of(preset: Preset, overrides: Mapping[str, Any]) -> Schedule:
    """Return the preset's schedule with single numbers replaced. Raise DocumentError ``bad_schedule``."""
    try:
        return replace(preset.schedule, **overrides)
    except ValidationError as error:
        first = error.errors()[0]
        what = f"`{first['loc'][-1]}` of the schedule cannot be {first['input']!r:.60}: {first_fault(error)[1]}."
        raise DocumentError("bad_schedule", what, f"It has {', '.join(vars(preset.schedule))}.") from None
