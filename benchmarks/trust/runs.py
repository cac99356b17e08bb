"""One walk with every fault, in a process of its own."""

from __future__ import annotations

from typing import NamedTuple

from benchmarks.coverage.walks import walk
from benchmarks.trust.faults import cells


class Told(NamedTuple):
    """What the verdict on one cell says: see ``Cell``; its level, and the reasons against the result."""

    fault: str | None
    is_named: bool | None
    is_asked: bool
    level: str | None
    against: list[str]
    bound: float | None = None


def recording(seed: int, draw: int) -> list[Told]:
    """The cells of one walk."""
    return [
        Told(
            cell.fault,
            cell.is_named,
            cell.is_asked,
            cell.judged.verdict.level if cell.judged else None,
            cell.judged.verdict.against if cell.judged else [],
            cell.bound,
        )
        for cell in cells(walk(seed + draw), draw)
    ]
