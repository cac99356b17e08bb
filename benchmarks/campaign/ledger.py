"""What the service has acknowledged: what clients were told, and must find again."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from threading import Lock
from uuid import UUID

Mark = tuple[float, float, int]
"""u and v in pixels, and the version."""


@dataclass
class Ledger:
    """Written by many clients at once, each entry after its answer."""

    vehicles: set[UUID] = field(default_factory=set[UUID])
    rigs: set[UUID] = field(default_factory=set[UUID])
    sets: set[UUID] = field(default_factory=set[UUID])
    calibrations: dict[UUID, str] = field(default_factory=dict[UUID, str])
    """Which request it was."""
    recordings: dict[UUID, str] = field(default_factory=dict[UUID, str])
    """Of which walk."""
    completed: dict[UUID, str] = field(default_factory=dict[UUID, str])
    """The SHA-256 of the whole file, of uploads whose completion was acknowledged."""
    parts: dict[tuple[UUID, int], str] = field(default_factory=dict[tuple[UUID, int], str])
    """The SHA-256 of each acknowledged part, by recording and number."""
    detections: dict[UUID, str] = field(default_factory=dict[UUID, str])
    """Of which walk."""
    marks: dict[tuple[UUID, UUID, int], Mark] = field(default_factory=dict[tuple[UUID, UUID, int], Mark])
    """The last state, by person, recording and frame; each rig has one camera."""
    never_answered: list[str] = field(default_factory=list[str])
    answers: Counter[str] = field(default_factory=Counter[str])
    """How often clients were answered what, besides success."""
    lock: Lock = field(default_factory=Lock)

    def count_answer(self, what: str) -> None:
        """Count an answer that was no success."""
        with self.lock:
            self.answers[what] += 1
