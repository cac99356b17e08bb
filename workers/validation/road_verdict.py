# pyright: reportMissingTypeStubs=false
"""What a score over turns of the mount says of the calibration: a verdict and a sentence, and one for each axis."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import special

from apexcal.documents.validations import AxisCheck, AxisVerdict, TurnAxis
from workers.validation.offsets import Peak

# Below this offset nobody is accused: rings and columns of the supported sensors are 0.1 to 0.4 degrees apart.
FINE_DEG: Final = 0.15
# Chi-square of two freedoms exceeds it once in a thousand times.
_ONCE_IN_A_THOUSAND: Final = 13.816
# The peak leads by so many deviations of its lead. With images turned around, where nothing fits, it leads by 0.6.
_CLEAR: Final = 2.0
# An offset that is known less well says nothing about a knock of a quarter of a degree.
_VAGUE_DEG: Final = 0.25
_FEWEST_PARTS: Final = 8
# Of one camera's three axes together: how often a sound mount gets a `look`, and how often a `stop`. The issue of the
# check allows both in 0.02 of drives.
_LOOK_ALARMS: Final = 0.01
_STOP_ALARMS: Final = 0.001
# What all groups of a drive share, so that no jackknife shows it: an edge lies anywhere between two rings or columns.
# Root mean square on 84 drawn drives of sound mounts (8 sensors, `benchmarks/drives.py`, seeds 1000 and 2000).
_SHARED_DEG: Final[dict[TurnAxis, float]] = {"pitch": 0.055, "yaw": 0.055, "roll": 0.09}
# A drive tells an axis if it would show a turn of half a degree in nine of ten cases.
_MUST_SHOW_DEG: Final = 0.5
_NINE_OF_TEN: Final = 1.2816
_SAYS: Final[dict[AxisVerdict, str]] = {
    "pass": "The mount fits",
    "look": "The camera may have turned",
    "stop": "The camera has turned",
    "not_told": "Too uncertain",
}
_student_quantile: Callable[[float, float], float] = special.stdtrit


class ScoredDrive(NamedTuple):
    """What a check saw: `noun` of its parts, how many, the score at no offset and at one degree of yaw."""

    noun: str
    frames: int
    parts: int
    points: int
    score: float
    at_one_degree: float
    peak: Peak | None


def judge(watched: ScoredDrive) -> dict[str, Any]:
    """Verdict, sentence, and the members of a road score that follow from them."""
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
        f"{abs(peak.yaw_deg):.2f} +- {peak.sigma_yaw_deg:.2f} degrees of yaw and "
        f"{abs(peak.pitch_deg):.2f} +- {peak.sigma_pitch_deg:.2f} of pitch"
    )
    if sigma > _VAGUE_DEG:
        return document | {"verdict": "unknown", "sentence": f"{where}, which is too uncertain to judge the mount."}
    chi2 = (peak.yaw_deg / max(peak.sigma_yaw_deg, 1e-6)) ** 2 + (
        peak.pitch_deg / max(peak.sigma_pitch_deg, 1e-6)
    ) ** 2
    if chi2 > _ONCE_IN_A_THOUSAND and np.hypot(peak.yaw_deg, peak.pitch_deg) > FINE_DEG:
        return document | {"verdict": "disagrees", "sentence": f"The camera has turned against the LiDAR: {where}."}
    return document | {"verdict": "agrees", "sentence": f"The mount fits: {where}."}


def judge_axes(watched: ScoredDrive, roll: tuple[float, float] | None, groups: int) -> list[AxisCheck]:
    """A verdict for each turn of the mount. ``roll``: its peak and deviation, degrees; ``groups`` of the jackknife.

    The roll's score is that under pitch and yaw as they are, so it tells nothing where one of these is accused.
    """
    peak = watched.peak
    if peak is None or watched.parts < _FEWEST_PARTS or peak.lead < _CLEAR:
        few = peak is None or watched.parts < _FEWEST_PARTS
        why = (
            f"{watched.parts} {watched.noun} in {watched.frames} frames are too few." if few else "No turn fits best."
        )
        return [_not_told(axis, why) for axis in _SHARED_DEG]
    axes = [
        _judged("pitch", peak.pitch_deg, peak.sigma_pitch_deg, groups),
        _judged("yaw", peak.yaw_deg, peak.sigma_yaw_deg, groups),
    ]
    if any(axis.verdict in ("look", "stop") for axis in axes):
        return [*axes, _not_told("roll", "Roll is told once pitch and yaw fit.")]
    return [*axes, _judged("roll", *roll, groups) if roll else _not_told("roll", "No roll fits best.")]


def _not_told(axis: TurnAxis, why: str) -> AxisCheck:
    return AxisCheck(axis=axis, verdict="not_told", sentence=why)


def _judged(axis: TurnAxis, turn_deg: float, own_sigma_deg: float, groups: int) -> AxisCheck:
    """The verdict of one axis, by Student's t of as many freedoms as a jackknife over so many groups has."""
    sigma_deg = float(np.hypot(own_sigma_deg, _SHARED_DEG[axis]))
    look_deg, stop_deg = (
        _student_quantile(groups - 1.0, 1.0 - alarms / 6.0) * sigma_deg for alarms in (_LOOK_ALARMS, _STOP_ALARMS)
    )
    verdict: AxisVerdict = "pass"
    if abs(turn_deg) > look_deg:
        verdict = "stop" if abs(turn_deg) > stop_deg else "look"
    elif look_deg + _NINE_OF_TEN * sigma_deg > _MUST_SHOW_DEG:
        verdict = "not_told"
    sentence = (
        f"{_SAYS[verdict]}: the frames fit best with {abs(turn_deg):.2f} +- {sigma_deg:.2f} degrees more {axis}."
    )
    return AxisCheck(axis=axis, verdict=verdict, sentence=sentence, turn_deg=turn_deg, sigma_deg=sigma_deg)
