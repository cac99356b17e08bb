"""The facts that a sensor's stamps tell of a recording: its rate, its gaps, and what is wrong with its clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.recordings import Gap
from workers.readers.normalised.manifest import SensorStamps

_MAX_GAPS_LISTED: Final = 1000
_GAP_STEPS: Final = 1.75
_JUMP_NS: Final = 3_600_000_000_000
_JUMP_BACK_NS: Final = 1_000_000_000
# So many messages in a row stamped before an earlier one mean a clock that was set; a single one is late.
_SET_BACK_FOR: Final = 3


class StampReport(NamedTuple):
    """(N,) order that sorts the stamps (stable), what they tell, and sentences for the owner."""

    order: NDArray[np.int64]
    facts: SensorStamps
    warnings: Sequence[str]


def report_stamps(
    stamps_ns: NDArray[np.int64],
    name: str,
    omitted_ns: NDArray[np.int64] | None = None,
    *,
    has_times: bool = True,
) -> StampReport:
    """Look at one sensor's stamps.

    Args:
        stamps_ns: (N,) int64 as recorded, N at least 1.
        name: names the sensor in warnings.
        omitted_ns: (M,) int64 stamps of messages that were left out: they are no gap.
        has_times: they were recorded; made-up ones tell neither rate nor gaps.
    """
    order = np.argsort(stamps_ns, kind="stable")
    ordered = stamps_ns[order]
    every = ordered if omitted_ns is None else np.concatenate([ordered, omitted_ns])
    moments, alike = np.unique(every, return_counts=True)
    steps = np.diff(moments)
    back = np.flatnonzero(np.diff(stamps_ns) < 0)
    duplicates = len(ordered) - len(np.unique(ordered))
    median = float(np.median(steps)) if len(steps) and has_times else 0.0
    # A message with another's stamp is there: it fills the gap that its own stamp leaves, before or after the other.
    spare = np.maximum(alike[:-1], alike[1:]) - 1
    absent = np.rint(steps / median) - 1 - spare if median > 0 else np.zeros(len(steps))
    places = np.flatnonzero((steps > _GAP_STEPS * median) & (absent > 0)) if median > 0 else np.zeros(0, np.int64)
    gaps = [Gap(after_ns=int(moments[i]), duration_ns=int(steps[i])) for i in places[:_MAX_GAPS_LISTED]]
    usual = places[steps[places] <= _JUMP_NS]
    missing = int(np.sum(absent[usual]))
    jumps = _jumps(stamps_ns)
    warnings = [
        *_order_warnings(stamps_ns, back, duplicates, name),
        *(_jump_warning(jump, name) for jump in jumps[:1]),
    ]
    if len(usual):
        worst = int(usual[np.argmax(steps[usual])])
        warnings.append(
            f"{name}: {len(usual)} gaps, the longest of {steps[worst] / 1e9:.2f} s "
            f"after {moments[worst] / 1e9:.3f} s (usual step {median / 1e9:.3f} s); "
            f"about {missing} messages are missing."
        )
    facts = SensorStamps(
        count=len(ordered),
        first_ns=int(ordered[0]),
        last_ns=int(ordered[-1]),
        rate_hz=1e9 / median if median > 0 else None,
        gaps=gaps,
        gap_count=len(places),
        missing=missing,
        jumps=jumps,
        backwards=len(back),
        duplicates=duplicates,
    )
    return StampReport(order, facts, warnings)


def _jumps(stamps_ns: NDArray[np.int64]) -> list[Gap]:
    """Steps in recorded order that no pause explains: over an hour, or back by a second or for several messages."""
    steps = np.diff(stamps_ns)
    stays = np.zeros(len(steps), np.bool_)
    if len(steps) >= _SET_BACK_FOR:
        after = np.lib.stride_tricks.sliding_window_view(stamps_ns[1:], _SET_BACK_FOR)
        stays[: len(after)] = np.max(after, axis=1) < stamps_ns[: len(after)]
    back = (steps < -_JUMP_BACK_NS) | ((steps < 0) & stays)
    places = np.flatnonzero((steps > _JUMP_NS) | back)
    return [Gap(after_ns=int(stamps_ns[i]), duration_ns=int(steps[i])) for i in places[:_MAX_GAPS_LISTED]]


def _order_warnings(stamps_ns: NDArray[np.int64], back: NDArray[np.int64], duplicates: int, name: str) -> list[str]:
    sentences: list[str] = []
    if len(back):
        sentences.append(
            f"{name}: stamps run backwards {len(back)} times, first after {stamps_ns[back[0]] / 1e9:.3f} s; "
            "messages were ordered by stamp."
        )
    if duplicates:
        sentences.append(f"{name}: {duplicates} messages have the same stamp as the one before.")
    return sentences


def _jump_warning(jump: Gap, name: str) -> str:
    seconds = jump.duration_ns / 1e9
    if seconds < 0:
        return (
            f"{name}: the clock was set back by {-seconds:.1f} s after {jump.after_ns / 1e9:.3f} s; messages from "
            "before and after it are mixed where their stamps overlap. Leave that part out when marking."
        )
    return (
        f"{name}: the clock jumps by {seconds:.0f} s after {jump.after_ns / 1e9:.3f} s; "
        "so long a pause was probably not meant."
    )


def partial_ends(points: NDArray[np.int64]) -> list[str]:
    """Return which of the ``first`` and ``last`` sweep hold clearly fewer points than the others.

    Args:
        points: (N,) number of points of each sweep, in the order of the stamps.
    """
    if len(points) < 4:
        return []
    usual = float(np.median(points))
    return [end for end, count in (("first", points[0]), ("last", points[-1])) if count < 0.8 * usual]


def sweep_warnings(points: NDArray[np.int64], name: str) -> list[str]:
    """Sentences about partial sweeps."""
    usual = float(np.median(points))
    return [
        f"{name}: the {end} sweep is partial ({points[0 if end == 'first' else -1]} points of about {usual:.0f})."
        for end in partial_ends(points)
    ]


def shared_time(lidar: tuple[int, int], camera: tuple[int, int]) -> tuple[float, float]:
    """Return how long two sensors ran together: seconds, and share of the LiDAR's time (1 for a single sweep inside).

    Args:
        lidar, camera: first and last stamp, nanoseconds.
    """
    shared = min(lidar[1], camera[1]) - max(lidar[0], camera[0])
    if shared < 0:
        return 0.0, 0.0
    whole = lidar[1] - lidar[0]
    return shared / 1e9, shared / whole if whole else 1.0


def overlap_warning(name: str, lidar: tuple[int, int], camera: tuple[int, int]) -> list[str]:
    """A sentence where a camera's time span does not meet the LiDAR's, or covers less than half of it."""
    (first, last), (start, end) = lidar, camera
    if start > last or end < first:
        away = (start - last if start > last else first - end) / 1e9
        return [
            f"lidar and {name} share no time: {name} {'begins' if start > last else 'ends'} {away:.1f} s "
            f"{'after the last' if start > last else 'before the first'} sweep. "
            "Their clocks differ, or the files are of two recordings; no frame can be paired."
        ]
    seconds, share = shared_time(lidar, camera)
    if share < 0.5:
        return [
            f"lidar and {name} share {seconds:.1f} s, {100 * share:.0f} % of the LiDAR's time; sweeps outside of it "
            "have no frame."
        ]
    return []
