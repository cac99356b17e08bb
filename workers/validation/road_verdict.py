"""Judge a calibration by the scores of turns of its mount: a verdict and a sentence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from workers.validation.offsets import Peak

# Smaller offsets accuse no calibration: rings and columns of the supported sensors are 0.1 to 0.4 degrees apart.
FINE_DEG: Final = 0.15
# A chi-square of two degrees of freedom exceeds this once in a thousand times.
_ONCE_IN_A_THOUSAND: Final = 13.816
# A verdict needs a peak that leads by so many deviations of its lead. On reversed images, where nothing fits, a peak
# leads by 0.6.
_CLEAR: Final = 2.0
# A larger deviation of the offset hides a knock of a quarter of a degree.
_VAGUE_DEG: Final = 0.25
_FEWEST_PARTS: Final = 8
# Two tests of one drive contradict each other if they differ by more than this, and by more than chance would make
# them once in a thousand times.
_CONTRADICTION_DEG: Final = 0.3


class ScoredDrive(NamedTuple):
    """Counts and scores of a check.

    ``noun`` names the ``parts`` (edges, markers). ``score`` belongs to the mount as it is, ``at_one_degree`` to a yaw
    of one degree.
    """

    noun: str
    frames: int
    parts: int
    points: int
    score: float
    at_one_degree: float
    peak: Peak | None


def contradiction(first: Mapping[str, Any], second: Mapping[str, Any]) -> str | None:
    """Return the turns that two tests of one drive measure, as words, if these contradict each other.

    Turns to the same side may differ: a shift looks like a turn, and like a larger one for near things.

    Args:
        first, second: ``pitch_deg`` with ``sigma_pitch_deg``, and the same of yaw, of two road scores.

    Returns:
        None if they agree, or if a test measured no turn.
    """
    for name in ("pitch", "yaw"):
        turn, other = first.get(f"{name}_deg"), second.get(f"{name}_deg")
        if turn is None or other is None:
            continue
        sigma, other_sigma = float(first[f"sigma_{name}_deg"]), float(second[f"sigma_{name}_deg"])
        apart = float(turn - other)
        is_apart = abs(apart) > _CONTRADICTION_DEG and apart**2 > _ONCE_IN_A_THOUSAND * (sigma**2 + other_sigma**2)
        are_clear = abs(turn) > _CLEAR * sigma and abs(other) > _CLEAR * other_sigma
        if is_apart and not (are_clear and turn * other > 0.0):
            return f"{turn:+.2f} and {other:+.2f} degrees of {name}"
    return None


def judge(watched: ScoredDrive) -> dict[str, Any]:
    """Return verdict, sentence and the other members of a road score."""
    peak, noun = watched.peak, watched.noun
    document: dict[str, Any] = {
        "frames": watched.frames,
        "parts": watched.parts,
        "points": watched.points,
        "score": None,
        "score_at_one_degree": None,
    }
    if peak is None or watched.parts < _FEWEST_PARTS:
        sentence = f"{watched.frames} frames show {watched.parts} {noun}: too few for a verdict."
        return document | {"verdict": "unknown", "sentence": sentence}
    document |= {"score": watched.score, "score_at_one_degree": watched.at_one_degree}
    if peak.lead < _CLEAR:
        sentence = f"No turn of the mount fits {watched.parts} {noun} clearly better than all others: no verdict."
        return document | {"verdict": "unknown", "sentence": sentence}
    sigma = float(np.hypot(peak.sigma_pitch_deg, peak.sigma_yaw_deg))
    document |= {
        "yaw_deg": peak.yaw_deg,
        "pitch_deg": peak.pitch_deg,
        "sigma_yaw_deg": peak.sigma_yaw_deg,
        "sigma_pitch_deg": peak.sigma_pitch_deg,
    }
    where = (
        f"{watched.parts} {noun} in {watched.frames} frames fit best with the camera turned by "
        f"{peak.yaw_deg:+.2f} +- {peak.sigma_yaw_deg:.2f} degrees of yaw and "
        f"{peak.pitch_deg:+.2f} +- {peak.sigma_pitch_deg:.2f} of pitch"
    )
    if sigma > _VAGUE_DEG:
        return document | {"verdict": "unknown", "sentence": f"{where}, which is too uncertain to judge the mount."}
    chi2 = (peak.yaw_deg / max(peak.sigma_yaw_deg, 1e-6)) ** 2 + (
        peak.pitch_deg / max(peak.sigma_pitch_deg, 1e-6)
    ) ** 2
    if chi2 > _ONCE_IN_A_THOUSAND and np.hypot(peak.yaw_deg, peak.pitch_deg) > FINE_DEG:
        return document | {"verdict": "disagrees", "sentence": f"The camera has turned against the LiDAR: {where}."}
    return document | {"verdict": "agrees", "sentence": f"The mount fits: {where}."}
