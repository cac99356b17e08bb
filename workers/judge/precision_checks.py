"""Checks of precision: of projected points, where mount and lens are used together, and of the mount alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.camera_models import ANGLES
from apexcal.documents.checks import (
    ALONE_LIMIT_DEG,
    ALONE_LIMIT_MM,
    USE_LIMIT_M,
    USE_LIMIT_PX,
    USE_LIMIT_RAD,
    Check,
    CheckTopic,
    alone_over_limits,
    figure,
)
from apexcal.documents.results import FitResult
from workers.judge.effects import MIDDLE, over_limit, worst_axis
from workers.judge.topics import more_corners
from workers.solver.estimate import Estimate
from workers.solver.next_steps import sentence as next_sentence
from workers.solver.prediction import DISTANCES_M

Floats = NDArray[np.float64]
# scipy publishes no types.
_student_quantile: Callable[[Floats, float], Floats] = special.stdtrit
_USE: Final = CheckTopic("precision", "Precision where it is used")
_ALONE: Final = CheckTopic("mount_alone", "Mount without its lens", "mount_alone")
# A half-width of so many times the limit is of no use.
_USELESS: Final = 3.0
_MOST_FREEDOM: Final = 1e9  # Student's t is the normal distribution's long before


def precision(estimate: Estimate, result: FitResult, pairs: Mapping[str, Sequence[Any]]) -> Check:
    """Whether points at 5, 20 and 50 m, over the field that marks cover, are placed as well as their use needs.

    pairs: columns of the set, if at hand.
    """
    more = more_corners(pairs)
    if estimate.errors is None:
        return _USE.fails("stop", "The pairs do not tell how precise the result is.", f"{more}.")
    worst, px = stated_over_limit(estimate, result)
    parts = result.next_steps.parts if result.next_steps else {}
    widest = np.quantile(px, MIDDLE, axis=1).tolist()
    named = [f"{distance:.0f}" for distance in DISTANCES_M]
    sizes = [f"{figure(off_px)} px at {name} m" for off_px, name in zip(widest, named, strict=True)]
    limit = f"{USE_LIMIT_PX:g} px, {1e3 * USE_LIMIT_RAD:g} mrad or {1e3 * USE_LIMIT_M:g} mm"
    return _USE.fails(
        "pass" if worst <= 1.0 else "look" if worst <= _USELESS else "stop",
        f"Points where the marks are may be {', '.join(sizes)} off (95 %): "
        + (f"within the limit ({limit})." if worst <= 1.0 else f"{worst:.2f} times the limit ({limit})."),
        f"{more}, nearer and towards the image's edges"
        + (", or measure the board" if max(parts, key=lambda name: parts[name], default="") == "board" else "")
        + (", or state the lens." if result.lens == "fitted" else "."),
        over_limit=worst,
        **{f"half_width_at_{name}_m_px": value for name, value in zip(named, widest, strict=True)},
    )


def stated_over_limit(estimate: Estimate, result: FitResult) -> tuple[float, Floats]:
    """The 95 % half-widths of points of use over what use allows, and each of them (distances, R), px.

    If halves of the pairs differ by more than is stated, the half-widths grow as much. ``estimate.errors`` is there.
    """
    px, mm, freedoms = worst_axis(estimate)
    # Each point has the degrees of freedom of its own variance, of which most may be stated.
    factor = np.asarray(_student_quantile(np.clip(freedoms, 1.0, _MOST_FREEDOM), 0.975), np.float64)
    factor = factor * (result.prediction.expected_over_stated if result.prediction else 1.0)
    return over_limit(factor * px, factor * mm), factor * px


def mount_alone(result: FitResult) -> Check:
    """Whether the mount is known well enough for who uses it with another lens, by degrees and millimetres."""
    half_widths = result.interval95_half_width
    turns = [value for name, value in half_widths.items() if name in ANGLES]
    shifts = [value for name, value in half_widths.items() if name.startswith("t_")]
    turn, shift = _largest(turns), _largest(shifts)
    lens = result.lens
    good, wording = False, "not determined"
    if turn is not None and shift is not None:
        good = max(alone_over_limits(turn, 1e3 * shift)) <= 1.0
        wording = (
            f"uncertain by {figure(turn)} degrees (limit {ALONE_LIMIT_DEG:g}) and {figure(1e3 * shift)} mm "
            f"(limit {ALONE_LIMIT_MM:g}), at 95 %"
        )
    return _ALONE.fails(
        "pass" if good else "stop",
        f"Without its lens ({lens}) the mount is {wording}.",
        "Load mount and lens together. "
        + (next_sentence(result.next_steps) if result.next_steps else "State the lens." * (lens == "fitted")),
        half_width_deg=turn,
        half_width_mm=None if shift is None else 1e3 * shift,
    )


def _largest(values: list[float | None]) -> float | None:
    """The largest; 0 if all are locked, None if one is not determined."""
    finite = [value for value in values if value is not None]
    return max(finite, default=0.0) if len(finite) == len(values) else None
