"""How long and how wide the genetic algorithm searches: the named schedules."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Literal, get_args

from workers.solver.errors import SolveError

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


def schedule_of(preset: object, overrides: Mapping[str, Any]) -> Schedule:
    """The preset's schedule with single numbers replaced. Raises SolveError."""
    for name in get_args(PresetName):
        if preset == name:
            return check_schedule(_replaced(PRESETS[name], overrides))
    raise SolveError(
        "unknown_preset", f"There is no preset named {preset!r}.", f"The presets are {', '.join(PRESETS)}."
    )


def _replaced(schedule: Schedule, overrides: Mapping[str, Any]) -> Schedule:
    known = {field.name for field in fields(Schedule)}
    unknown = [name for name in overrides if name not in known]
    if unknown:
        raise SolveError("bad_schedule", f"`schedule` has no {unknown[0]!r}.", f"It has {', '.join(sorted(known))}.")
    try:
        return replace(
            schedule,
            **{
                name: None
                if value is None
                else float(value)
                if name in ("scale", "tolerance", "goal_px")
                else int(value)
                for name, value in overrides.items()
            },
        )
    except (TypeError, ValueError) as error:
        raise SolveError("bad_schedule", f"`schedule` holds something that is no number: {error}.", "") from error


def check_schedule(schedule: Schedule) -> Schedule:
    """The schedule itself, if it can be run. Raises SolveError `bad_schedule`."""
    rules: tuple[tuple[str, bool, str], ...] = (
        ("slots", 1 <= schedule.slots <= 1000, "from 1 to 1000"),
        ("population", 64 <= schedule.population <= 100_000, "from 64 to 100000"),
        ("generations", 1 <= schedule.generations <= 10_000, "from 1 to 10000"),
        ("scale", 0.0 < schedule.scale <= 1.0, "above 0 and at most 1"),
        ("max_iterations", 1 <= schedule.max_iterations <= 1000, "from 1 to 1000"),
        ("patience", schedule.patience >= 1, "at least 1"),
        ("tolerance", 0.0 <= schedule.tolerance < 1.0, "from 0 to below 1"),
        ("goal_px", schedule.goal_px is None or schedule.goal_px > 0.0, "above 0, or null"),
    )
    for name, holds, wanted in rules:
        if not holds:
            raise SolveError("bad_schedule", f"`{name}` is {getattr(schedule, name)}.", f"It must be {wanted}.")
    return schedule
