"""What a sensor's stamps tell of a recording: its rate, its gaps, and what is wrong with its clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.manifest import MAX_GAPS_LISTED, Gap

_GAP_STEPS: Final = 1.75
_JUMP_NS: Final = 3_600_000_000_000


@dataclass(frozen=True, slots=True)
class StampReport:
    """See :class:`workers.readers.manifest.SensorManifest` for the fields."""

    order: NDArray[np.int64]
    first_ns: int
    last_ns: int
    rate_hz: float | None
    gaps: Sequence[Gap]
    gap_count: int
    warnings: Sequence[str]


def report_stamps(stamps_ns: NDArray[np.int64], name: str) -> StampReport:
    """Look at one sensor's stamps.

    Args:
        stamps_ns: (N,) int64 as recorded, N at least 1.
        name: names the sensor in warnings.

    Returns:
        ``order`` sorts the stamps (stable).
    """
    warnings: list[str] = []
    order = np.argsort(stamps_ns, kind="stable")
    ordered = stamps_ns[order]
    steps = np.diff(ordered)
    back = np.flatnonzero(np.diff(stamps_ns) < 0)
    if len(back):
        warnings.append(
            f"{name}: stamps run backwards {len(back)} times, first after {stamps_ns[back[0]] / 1e9:.3f} s; "
            "messages were ordered by stamp."
        )
    twins = int(np.count_nonzero(steps == 0))
    if twins:
        warnings.append(f"{name}: {twins} messages have the same stamp as the one before.")
    median = float(np.median(steps)) if len(steps) else 0.0
    places = np.flatnonzero(steps > _GAP_STEPS * median) if median > 0 else np.zeros(0, np.int64)
    gaps = [Gap(int(ordered[i]), int(steps[i])) for i in places[:MAX_GAPS_LISTED]]
    jumps = [gap for gap in gaps if gap.duration_ns > _JUMP_NS]
    if jumps:
        warnings.append(
            f"{name}: the clock jumps by {jumps[0].duration_ns / 1e9:.0f} s after {jumps[0].after_ns / 1e9:.3f} s; "
            "a recording this long with nothing in between was probably not meant."
        )
    elif len(places):
        worst = int(places[np.argmax(steps[places])])
        warnings.append(
            f"{name}: {len(places)} gaps, the longest of {steps[worst] / 1e9:.2f} s "
            f"after {ordered[worst] / 1e9:.3f} s (usual step {median / 1e9:.3f} s)."
        )
    return StampReport(
        order=order,
        first_ns=int(ordered[0]),
        last_ns=int(ordered[-1]),
        rate_hz=1e9 / median if median > 0 else None,
        gaps=gaps,
        gap_count=len(places),
        warnings=warnings,
    )


def partial_sweeps(points: NDArray[np.int64], name: str) -> list[str]:
    """Sentences about a first or last sweep that holds clearly fewer points than the others."""
    if len(points) < 4:
        return []
    usual = float(np.median(points))
    ends = (("first", points[0]), ("last", points[-1]))
    said = [
        f"{name}: the {which} sweep is partial ({count} points of about {usual:.0f})."
        for which, count in ends
        if count < 0.8 * usual
    ]
    empty = int(np.count_nonzero(points == 0))
    return [*said, f"{name}: {empty} sweeps hold no point."] if empty else said


def overlap(spans: Sequence[tuple[str, int, int]]) -> list[str]:
    """Sentences about cameras whose time span does not meet the LiDAR's.

    Args:
        spans: (name, first stamp, last stamp), the LiDAR first.
    """
    if not spans:
        return []
    lidar, first, last = spans[0]
    said: list[str] = []
    for name, start, end in spans[1:]:
        if start > last or end < first:
            away = (start - last if start > last else first - end) / 1e9
            said.append(
                f"{lidar} and {name} share no time: {name} {'begins' if start > last else 'ends'} {away:.1f} s "
                f"{'after the last' if start > last else 'before the first'} sweep. "
                "Their clocks differ, or the files are of two recordings; no frame can be paired."
            )
    return said
