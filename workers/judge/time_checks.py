"""Checks of time: clocks that are apart, and rows that are read one after the other."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.checks import Check, CheckTopic
from apexcal.documents.results import FitResult
from workers.judge.residual_patterns import pattern_test
from workers.judge.topics import MATTERS, graded
from workers.solver.estimate import Estimate
from workers.solver.residuals import by_point, predict

Floats = NDArray[np.float64]
_CLOCK: Final = CheckTopic("clock", "Clocks of camera and LiDAR")
_SHUTTER: Final = CheckTopic("rolling_shutter", "Rolling shutter")


def clock(estimate: Estimate) -> Check:
    """Whether the marks lie where the board was at another moment: the clocks' offset."""
    if estimate.holding.velocities is None:
        return _CLOCK.passes("Not checked: still poses, and pairs without times, do not say how the board moved.")
    moved = image_velocities(estimate)
    test = pattern_test(estimate, moved[:, :, None])
    if test is None or not np.isfinite(test.deviations[0]):
        return _CLOCK.passes("The board's motion does not distinguish the clocks' offset from an error of the mount.")
    seconds, deviation = float(test.values[0]), float(test.deviations[0])
    speed_px_s = _speed(estimate, moved)
    verdict = graded(test.probability, abs(seconds) * speed_px_s, MATTERS * estimate.spread.sigma_px)
    fitted = estimate.clock
    beside = fitted and f"The fit estimates {fitted.offset_ms:.1f} ± {fitted.std_ms:.1f} ms beyond the pairs' offset."
    offset = f"{1e3 * abs(seconds):.1f} ± {1e3 * deviation:.1f} ms"
    return _CLOCK.fails(
        verdict,
        beside or f"The marks follow the board's motion: the clocks differ by {offset}."
        if verdict == "pass"
        else f"The clocks differ by {offset}: the marks lie where the board was so much "
        f"{'later' if seconds > 0 else 'earlier'} than the pairs say.",
        "Estimate the clocks' offset, and detect again.",
        seconds=seconds,
        deviation_seconds=deviation,
        speed_px_s=speed_px_s,
        probability=test.probability,
    )


def rolling_shutter(estimate: Estimate, result: FitResult, clocks: Check) -> Check:
    """Whether the camera reads its rows one after the other, beyond the stated line time.

    It matters if marks at the image's upper and lower edge are off by more than half of their noise. If the clocks
    are off and explain the residuals better, the check says nothing of the rows.
    """
    shown = result.rolling_shutter
    if not shown:
        return _SHUTTER.passes("The pairs do not say how the rows of a frame are read.")
    line_us, std_us = shown.line_time_us, max(shown.std_us, 1e-9)
    line = f"{line_us:.0f} ± {std_us:.0f} microseconds a row"
    if clocks.verdict != "pass" and _deviations(clocks) >= abs(line_us) / std_us:
        return _SHUTTER.passes(f"The clocks' offset explains the residuals better than rows read in turn ({line}).")
    speed_px_s = _speed(estimate, image_velocities(estimate)) if estimate.holding.velocities is not None else 0.0
    off_px = 0.5e-6 * abs(line_us) * estimate.holding.image_size[1] * speed_px_s
    probability = 2.0 * float(special.ndtr(-abs(line_us) / std_us))
    verdict = graded(probability, off_px, MATTERS * estimate.spread.sigma_px) if shown.shown else "pass"
    total = result.line_time_us + line_us
    return _SHUTTER.fails(
        verdict,
        f"All rows of a frame show the same moment: {line}."
        if verdict == "pass"
        else f"Residuals along the board's motion grow with the image row, by {line}: the camera reads its rows one "
        "after the other.",
        f"State line_time_us, about {total:.0f}; better what the camera's data sheet says.",
        line_time_us=line_us,
        std_us=std_us,
        limit=shown.limit,
        speed_px_s=speed_px_s,
    )


def image_velocities(estimate: Estimate) -> Floats:
    """(N, 2) velocity of each pair's projection, px/s; zero where there is none."""
    problem = estimate.holding
    assert problem.velocities is not None
    _, violation = predict(problem, estimate.held_at)
    moved = np.einsum("nij,nj->ni", by_point(problem, estimate.held_at), problem.velocities)
    return np.where((violation > 0.0)[:, None], 0.0, moved)


def _speed(estimate: Estimate, moved: Floats) -> float:
    return float(np.median(np.hypot(*moved[estimate.holding.weights > 0.0].T)))


def _deviations(clocks: Check) -> float:
    seconds, deviation = clocks.figures["seconds"] or 0.0, clocks.figures["deviation_seconds"] or 1e-12
    return abs(seconds) / deviation
