"""The columns of correspondences, and how pairs are held out together."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from typing import Any, Final

REQUIRED: Final = ("x", "y", "z", "u", "v")
# Standard deviations of the vertex as the LiDAR sees it, and of the mark in pixels per coordinate.
SIGMAS: Final = ("sigma_azimuth_rad", "sigma_elevation_rad", "sigma_range_m")
MARK_SIGMA: Final = "sigma_px"
# Whose marks a pair stands on: numbers of people, from 0, without names. The clock's: of the offset that was assumed.
MARKED_BY: Final = "marked_by"
CLOCK_SIGMA: Final = "sigma_clock_ms"
# Whether a pair stands on the machine's mark alone, how many people confirmed it after they saw it, and the machine's
# mark minus people's blind ones (u, v) where there are both.
MACHINE: Final = "machine"
CONFIRMED: Final = "confirmed"
MACHINE_OFF: Final = "machine_off_px"
# How the corner moved at the vertex's time, m/s in the LiDAR's frame (x, y, z), by all vertices near in time, marked
# or not. Where the column is missing, pairs near in time tell it.
VELOCITY: Final = "velocity_m_s"
# Which corner of the board a pair is of; all are of the tip where the column is missing.
CORNER: Final = "corner"
# How far to look from a pair for others that tell its velocity: in nanoseconds, and in pairs on either side. A sensor
# of 10 Hz has five sweeps in that time.
REACH_NS: Final = 500_000_000
NEIGHBOURS: Final = 5
_MOMENT_NS: Final = 1_500_000  # nearer together, two stamps are of one moment


def states_errors(pairs: Mapping[str, Any]) -> bool:
    """Whether all pairs of these columns state their vertices' deviations, or their marks'."""
    return all(name in pairs for name in SIGMAS) or MARK_SIGMA in pairs


def tells_motion(stamps_ns: Sequence[int], corners: Sequence[str] | None = None) -> bool:
    """Whether at least half of the pairs have another pair near in time, which tells how their corner moved.

    Near is within half a second: a walker at 1.2 m/s hardly turns in that time. The five pairs before and the five
    after each pair are looked at. ``corners``: each pair's corner; then only pairs of the same corner count.
    """
    times: dict[str, list[int]] = {}
    for index, stamp in enumerate(stamps_ns):
        times.setdefault(corners[index] if corners else "", []).append(stamp)
    return 2 * sum(_near_others(sorted(of_corner)) for of_corner in times.values()) >= len(stamps_ns) > 0


def _near_others(times: Sequence[int]) -> int:
    """Count these ascending times that have another one near."""
    count = 0
    for index, at in enumerate(times):
        first, stop = max(index - NEIGHBOURS, 0), min(index + NEIGHBOURS + 1, len(times))
        before = bisect_right(times, at - _MOMENT_NS, first, index) - 1
        after = bisect_left(times, at + _MOMENT_NS, index + 1, stop)
        count += (before >= first and at - times[before] <= REACH_NS) or (
            after < stop and times[after] - at <= REACH_NS
        )
    return count


def held_together(pairs: Mapping[str, Any]) -> Sequence[Any]:
    """A value for each pair, its pose, moment or own number; pairs of equal values are held out together."""
    return pairs.get("group") or pairs.get("stamp_ns") or range(len(pairs["x"]))
