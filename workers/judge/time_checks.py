"""Checks of time: clocks that are apart, and rows that are read one after the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from apexcal.documents.checks import Check, CheckTopic, figure
from apexcal.documents.results import FitResult
from workers.judge.causes import CLOCK, LENS, SHUTTER, Finding
from workers.judge.topics import graded

_CLOCK: Final = CheckTopic(CLOCK, "Clocks of camera and LiDAR")
_SHUTTER: Final = CheckTopic(SHUTTER, "Rolling shutter")
_WALK: Final = "Record a walk across the view to both sides, fast and slowly, with times of frames and sweeps."
_TITLES: Final = {CLOCK: "the clocks' offset", SHUTTER: "rows read in turn", LENS: "the lens model"}


def clock(causes: Mapping[str, Finding], result: FitResult) -> Check:
    """Whether the marks lie where the board was at another moment: the clocks' offset."""
    finding = causes.get(CLOCK)
    if finding is None:
        return _CLOCK.not_checked("Still poses, and pairs without times, do not say how the board moved.", _WALK)
    seconds, deviation = float(finding.test.values[0]), float(finding.test.deviations[0])
    if not np.isfinite(deviation):
        return _CLOCK.not_checked(
            "The board's motion does not distinguish the clocks' offset from an error of the mount.", _WALK
        )
    offset = f"{1e3 * abs(seconds):.1f} ± {1e3 * deviation:.1f} ms"
    figures = {"seconds": seconds, "deviation_seconds": deviation} | _figures(finding)
    if not finding.is_named and not finding.is_told:
        return _CLOCK.not_checked(f"The clocks' offset ({offset}) is too uncertain to judge.", _WALK, **figures)
    verdict = graded(finding.test.probability, finding.effect) if finding.is_named else "pass"
    fitted = result.clock_offset
    beside = (
        f" The fit estimates {fitted.offset_ms:.1f} ± {fitted.std_ms:.1f} ms beyond the pairs' offset."
        if fitted
        else ""
    )
    way = "later" if seconds > 0 else "earlier"
    return _CLOCK.fails(
        verdict,
        f"The clocks differ by {offset}: marks show the board {way} than the pairs say. {_effect(finding)}{beside}"
        if finding.is_named
        else f"The clocks agree: an offset of {offset} is within chance{_beside(finding)}.{beside}",
        "Are the clocks apart? Estimate their offset on the recording's page, detect again, and compare held-out "
        "errors.",
        **figures,
    )


def rolling_shutter(causes: Mapping[str, Finding], result: FitResult) -> Check:
    """Whether the camera reads its rows one after the other, beyond the stated line time."""
    finding = causes.get(SHUTTER)
    if finding is None or not np.isfinite(finding.test.deviations[0]):
        return _SHUTTER.not_checked("The pairs do not say how the rows of a frame are read.", _WALK)
    line_us, std_us = float(finding.test.values[0]), float(finding.test.deviations[0])
    line = f"{line_us:.0f} ± {std_us:.0f} microseconds a row"
    figures = {"line_time_us": line_us, "std_us": std_us} | _figures(finding)
    if not finding.is_named and not finding.is_told:
        return _SHUTTER.not_checked(f"The line time ({line}) is too uncertain to judge.", _WALK, **figures)
    return _SHUTTER.fails(
        graded(finding.test.probability, finding.effect) if finding.is_named else "pass",
        f"The camera seems to read its rows one after the other ({line}). {_effect(finding)}"
        if finding.is_named
        else f"All rows of a frame show the same moment: {line} is within chance{_beside(finding)}.",
        f"Does the camera have a rolling shutter? Its data sheet states the line time; the pairs suggest "
        f"{result.line_time_us + line_us:.0f} microseconds (line_time_us).",
        **figures,
    )


def _figures(finding: Finding) -> dict[str, float | None]:
    effect = finding.effect
    return {"probability": finding.test.probability, "over_limit": effect.estimate, "at_least": effect.at_least}


def _effect(finding: Finding) -> str:
    return f"Points at 5 to 50 m move by {figure(finding.effect.estimate)} times the limit."


def _beside(finding: Finding) -> str:
    return f" (fitted with {' and '.join(_TITLES[name] for name in finding.rivals)})" if finding.rivals else ""
