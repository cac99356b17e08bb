"""A region of interest suggested from what moves against the still background of a recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypedDict

from workers.readers.recording import Sweep


class SweepSource(Protocol):
    """Sweeps by index, as a normalised LiDAR file gives them."""

    def __len__(self) -> int: ...

    def sweep(self, index: int) -> Sweep: ...


class SuggestionFacts(TypedDict):
    """What the suggestion rests on: plain JSON, for the person who decides."""

    sweeps_read: int
    sweeps_moving: int
    points_moving_per_sweep: float
    area_m2: float
    z_low: float
    z_high: float
    reasons: list[str]


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A region document (see `region`) and what it rests on."""

    document: dict[str, Any]
    facts: SuggestionFacts


def suggest(source: SweepSource, *, samples: int = 240, on_sweep: Callable[[int], None] | None = None) -> Suggestion:
    """The region that the moving person and board walked through, with a margin, off the ground.

    Args:
        source: the sweeps of a recording whose LiDAR stands still.
        samples: how many sweeps to read, spread over the recording.
        on_sweep: called with the number of sweeps read so far.

    Raises:
        InputError: ``too_few_sweeps``, ``nothing_moves``, ``everything_moves``.
    """
    raise NotImplementedError
