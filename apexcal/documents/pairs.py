"""The columns of correspondences, and how pairs are held out together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

REQUIRED: Final = ("x", "y", "z", "u", "v")
# Standard deviations of the vertex as the LiDAR sees it, and of the mark in pixels per coordinate.
SIGMAS: Final = ("sigma_azimuth_rad", "sigma_elevation_rad", "sigma_range_m")
MARK_SIGMA: Final = "sigma_px"
# Whose marks a pair stands on: numbers of people, from 0, without names. The clock's: of the offset that was assumed.
MARKED_BY: Final = "marked_by"
CLOCK_SIGMA: Final = "sigma_clock_ms"
# Which corner of the board a pair is of; all are of the tip where the column is missing.
CORNER: Final = "corner"


def states_errors(pairs: Mapping[str, Any]) -> bool:
    """Whether all pairs of these columns state their vertices' deviations, or their marks'."""
    return all(name in pairs for name in SIGMAS) or MARK_SIGMA in pairs


def held_together(pairs: Mapping[str, Any]) -> Sequence[Any]:
    """A value for each pair, its pose, moment or own number; pairs of equal values are held out together."""
    return pairs.get("group") or pairs.get("stamp_ns") or range(len(pairs["x"]))
