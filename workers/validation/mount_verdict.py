# pyright: reportMissingTypeStubs=false
"""Judge a mount by the places where depth edges lie best: a verdict for it and for each turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import special

from apexcal.documents.validations import AxisCheck, AxisVerdict, TurnAxis
from workers.validation.mount_search import REACH_DEG, Summit
from workers.validation.road_verdict import contradiction

# A verdict needs a peak that leads by so many deviations of its lead. On reversed images, where nothing fits, a peak
# leads by 0.6.
CLEAR: Final = 2.0
# A place next to the deployed mount needs less of a lead over places far off, where mounts rarely are.
_CLEAR_OF_FAR: Final = 1.0
# A mount that is off by more is far off, and its figures are to a degree.
FAR_DEG: Final = 1.5
ABOUT_DEG: Final = 1.0
FEWEST_PARTS: Final = 8
_FEWEST_GROUPS: Final = 4
# Of one camera's three axes together: how often a sound mount gets a `look`, and how often a `stop`. The issue of the
# check allows both in 0.02 of drives.
_LOOK_ALARMS: Final = 0.01
_STOP_ALARMS: Final = 0.001
# What all groups of a drive share, so that no jackknife shows it.
SHARED_DEG: Final[dict[TurnAxis, float]] = {"pitch": 0.055, "yaw": 0.055, "roll": 0.09}
_SHARED_M: Final = 0.02
# A drive tells an axis if it would show a turn of half a degree in nine of ten cases.
_MUST_SHOW_DEG: Final = 0.5
_NINE_OF_TEN: Final = 1.2816
GRAVITY: Final[tuple[AxisVerdict, ...]] = ("pass", "not_told", "look", "stop")
_SHIFTS: Final = ("x (right)", "y (down)", "z (ahead)")
_student_quantile: Callable[[float, float], float] = special.stdtrit


class Summits(NamedTuple):
    """The summits that a search of mounts ended with.

    Attributes:
        frames, parts: that were looked at; edges in them.
        turned, shifted: where edges lie best if the camera turned only, or shifted only.
        moved: where they lie best if it did both.
        aimed, rolled: next to the deployed mount, if only pitch and yaw, or only the roll, are off.
        near, far: other summits of turns, nearer to the deployed mount than FAR_DEG, or farther off.
        apart_deg: how far the typical edge moves between the deployed mount and `turned`.
        left_deg: of a mount that is far off, how far `turned` is from places that fit as well and to the same side.
    """

    frames: int
    parts: int
    turned: Summit
    shifted: Summit
    moved: Summit
    aimed: Summit
    rolled: Summit
    near: Sequence[Summit]
    far: Sequence[Summit]
    apart_deg: float
    left_deg: float = 0.0

    @property
    def groups(self) -> int:
        """Groups of the jackknife."""
        return int(np.count_nonzero(self.turned.counts))


class MountVerdict(NamedTuple):
    """A verdict, its reason, and what is said of each turn."""

    verdict: AxisVerdict
    sentence: str
    axes: list[AxisCheck]


def judge_mount(
    summits: Summits | None, frames: int, lanes: dict[str, Any] | None = None, *, is_motion_told: bool = True
) -> MountVerdict:
    """The verdict of depth edges, and of lane markers where their document is given.

    One frame alone, and frames of a vehicle whose motion is not told, give no `stop`.
    """
    proof = "" if is_motion_told else "Points stay where they were measured, which is no proof: record at 10 Hz."
    proof = "One frame alone is no proof: record a drive." if frames == 1 else proof
    gravest: AxisVerdict = "look" if proof else "stop"
    if summits is None or summits.parts < FEWEST_PARTS or summits.groups < _FEWEST_GROUPS:
        parts = summits.parts if summits else 0
        judged = _no_verdict(f"{frames} frames show {parts} depth edges: too few for a verdict.")
    else:
        judged = _judged(summits, gravest)
    judged = _with_lanes(judged, lanes or {"verdict": "unknown"})
    return judged._replace(sentence=f"{judged.sentence} {proof}") if proof and judged.verdict == "look" else judged


def _judged(summits: Summits, gravest: AxisVerdict) -> MountVerdict:
    turned, is_far = summits.turned, summits.apart_deg > FAR_DEG
    if not turned.is_summit:
        return _no_verdict(
            f"No turn within {REACH_DEG:.0f} degrees fits: edges are few, or the mount is farther off."
        )
    leads = [turned.lead_over(other) / CLEAR for other in (*summits.near, *((summits.aimed,) if is_far else ()))]
    leads += [turned.lead_over(other) / (CLEAR if is_far else _CLEAR_OF_FAR) for other in summits.far]
    if min(leads, default=1.0) < 1.0:
        return _no_verdict("Depth edges fit in several places about equally well.")
    if is_far:
        return _far_off(summits, gravest)
    # Three turns at once are believed where they lead fewer turns clearly: noise finds a place for three more easily.
    simpler = max(summits.aimed, summits.rolled, key=lambda summit: summit.score)
    are_all_needed = turned.lead_over(simpler) > CLEAR or not simpler.is_summit
    axes = _axes(summits, (turned, turned, turned), gravest) if are_all_needed else []
    if all(axis.verdict in ("pass", "not_told") for axis in axes):
        # Next to a mount that may be sound each axis is told better while the others stay as they are.
        axes = _axes(summits, (summits.aimed, summits.aimed, summits.rolled), gravest)
        is_rolled = simpler is summits.rolled
        if any(axis.verdict in ("look", "stop") for axis in (axes[2:] if is_rolled else axes[:2])):
            why = "It can be judged once the other turns fit."
            axes = [_not_told(axis.axis, why) if (axis.axis == "roll") != is_rolled else axis for axis in axes]
    worst = max((axis.verdict for axis in axes), key=GRAVITY.index)
    is_shifted = _is_shifted(summits)
    if worst in ("look", "stop"):
        return _accused(summits, axes, worst, is_shifted=is_shifted)
    if is_shifted:
        return MountVerdict("look", f"The camera may have shifted {_shift(summits.moved)}.", axes)
    if worst == "pass":
        return MountVerdict("pass", "The mount fits in pitch, yaw and roll.", axes)
    fits = [axis.axis for axis in axes if axis.verdict == "pass"]
    missing = " and ".join(axis.axis for axis in axes if axis.verdict == "not_told")
    unclear = f"this drive does not tell {missing}."
    sentence = f"The mount fits in {' and '.join(fits)}; {unclear}" if fits else unclear.capitalize()
    return MountVerdict("not_told", sentence, axes)


def _accused(summits: Summits, axes: list[AxisCheck], worst: AxisVerdict, *, is_shifted: bool) -> MountVerdict:
    """Turned, shifted, both, or either: what leads the others by two deviations."""
    lead = summits.turned.lead_over(summits.shifted)
    may = "has" if worst == "stop" else "may have"
    turns = _turns([axis for axis in axes if axis.verdict in ("look", "stop")])
    if lead < -CLEAR:
        axes = [_not_told(axis.axis, "Turns can be judged once the shift is right.") for axis in axes]
        return MountVerdict(worst, f"The camera {may} shifted {_shift(summits.shifted)}.", axes)
    if lead < CLEAR and not is_shifted and summits.shifted.is_summit:
        either = f"The camera {may} turned or shifted, and this drive does not tell which: {turns}, or"
        return MountVerdict(worst, f"{either} shifted {_shift(summits.shifted)}.", axes)
    also = f", and may have shifted {_shift(summits.moved)}" if is_shifted else ""
    return MountVerdict(worst, f"The camera {may} turned{also}: the frames fit best with {turns}.", axes)


def _far_off(summits: Summits, gravest: AxisVerdict) -> MountVerdict:
    turns: dict[TurnAxis, float] = dict(zip(SHARED_DEG, np.degrees(summits.turned.offset[:3]).tolist(), strict=True))
    largest = max(map(abs, turns.values()))
    axes: list[AxisCheck] = []
    named: list[str] = []
    for axis, turn in turns.items():
        if abs(turn) <= 0.5 * largest:
            axes.append(_not_told(axis, "It can be judged once the mount is about right."))
            continue
        figure = f"{turn:+.0f}{f' +- {ceil(summits.left_deg)}' if summits.left_deg else ''} degrees"
        named.append(f"{figure} of {axis}")
        sigma_deg = max(float(ceil(summits.left_deg)), ABOUT_DEG)
        axes.append(
            AxisCheck(
                axis=axis, verdict=gravest, sentence=f"About {figure}.", turn_deg=round(turn), sigma_deg=sigma_deg
            )
        )
    about, where = f"about {' and '.join(named)}", "is" if gravest == "stop" else "may be"
    sentence = f"The mount {where} far off: the frames fit with {about}."
    if summits.turned.lead_over(summits.shifted) < CLEAR and summits.shifted.is_summit:
        sentence = f"The mount {where} far off: {about}, or shifted {_shift(summits.shifted)}."
    return MountVerdict(gravest, sentence, axes)


def _with_lanes(judged: MountVerdict, lanes: dict[str, Any]) -> MountVerdict:
    """Join the verdicts of edges and markers: none if their turns contradict each other; markers alone: `look`."""
    if lanes["verdict"] == "unknown":
        return judged
    edges: dict[str, Any] = {}
    for axis in judged.axes:
        if axis.verdict != "not_told" and (axis.sigma_deg or ABOUT_DEG) < ABOUT_DEG:
            edges |= {f"{axis.axis}_deg": axis.turn_deg, f"sigma_{axis.axis}_deg": axis.sigma_deg}
    if turns := contradiction(edges, lanes):
        return _no_verdict(f"Depth edges and lane markers contradict each other: {turns}.")
    if lanes["verdict"] == "disagrees":
        if judged.verdict in ("look", "stop"):
            return judged
        alone = "Lane markers do not lie on their paint: the camera may have turned or shifted."
        edges_alone = "By depth edges alone: " if judged.verdict == "pass" else ""
        return MountVerdict("look", f"{alone} {edges_alone}{judged.sentence}", judged.axes)
    return judged._replace(sentence=f"{judged.sentence} Lane markers agree.") if judged.verdict == "pass" else judged


def _is_shifted(summits: Summits) -> bool:
    """Whether a shift beside the turn fits clearly better, and by more than chance and sensors explain."""
    covariance = summits.moved.covariance[3:, 3:] + _SHARED_M**2 * np.eye(3)
    shift = summits.moved.offset[3:]
    chi2 = float(shift @ np.linalg.solve(covariance, shift))
    limit = 3.0 * float(special.fdtri(3, max(summits.groups - 3, 1), 1.0 - _LOOK_ALARMS / 10.0))
    return summits.moved.is_summit and summits.moved.lead_over(summits.turned) > CLEAR and chi2 > limit


def _axes(summits: Summits, of_axes: tuple[Summit, Summit, Summit], gravest: AxisVerdict) -> list[AxisCheck]:
    """The verdicts of pitch, yaw and roll, each by its summit."""
    return [
        _axis(
            axis,
            float(np.degrees(summit.offset[k])),
            float(np.degrees(np.sqrt(summit.covariance[k, k]))),
            summits.groups,
            gravest,
        )
        for k, (axis, summit) in enumerate(zip(SHARED_DEG, of_axes, strict=True))
    ]


def _axis(axis: TurnAxis, turn_deg: float, own_sigma_deg: float, groups: int, gravest: AxisVerdict) -> AxisCheck:
    """The verdict of one axis, by Student's t of as many freedoms as a jackknife over so many groups has."""
    sigma_deg = float(np.hypot(own_sigma_deg, SHARED_DEG[axis]))
    look_deg, stop_deg = (
        _student_quantile(groups - 1.0, 1.0 - alarms / 6.0) * sigma_deg for alarms in (_LOOK_ALARMS, _STOP_ALARMS)
    )
    shown_deg = look_deg + _NINE_OF_TEN * sigma_deg
    verdict: AxisVerdict = "pass"
    sigma_deg = _up(sigma_deg)
    figures = f"{turn_deg:+.2f} +- {sigma_deg:.2f} degrees"
    sentence = f"It fits: {figures}."
    if abs(turn_deg) > look_deg:
        verdict = gravest if abs(turn_deg) > stop_deg else "look"
        sentence = f"The frames fit best with {figures} more {axis}."
    elif shown_deg > _MUST_SHOW_DEG:
        verdict = "not_told"
        shown = f"shows turns from {_up(shown_deg):.2f} degrees on (limit {_MUST_SHOW_DEG:g})"
        sentence = f"This drive {shown if shown_deg <= REACH_DEG else 'shows no turn about this axis'}."
    return AxisCheck(axis=axis, verdict=verdict, sentence=sentence, turn_deg=turn_deg, sigma_deg=sigma_deg)


def _turns(axes: Sequence[AxisCheck]) -> str:
    return " and ".join(f"{axis.turn_deg:+.2f} +- {axis.sigma_deg:.2f} degrees of {axis.axis}" for axis in axes)


def _up(degrees: float) -> float:
    """Rounded up to a hundredth, so that what is said of an uncertainty is true."""
    return ceil(100.0 * degrees - 1e-6) / 100.0


def _shift(summit: Summit) -> str:
    """The largest component of a shift in words, rounded to centimetres."""
    shift_m, sigma_m = summit.offset[3:], np.hypot(np.sqrt(np.diag(summit.covariance)[3:]), _SHARED_M)
    largest = int(np.argmax(np.abs(shift_m) / sigma_m))
    return f"by {100.0 * shift_m[largest]:+.0f} +- {ceil(100.0 * sigma_m[largest])} cm along {_SHIFTS[largest]}"


def _not_told(axis: TurnAxis, why: str) -> AxisCheck:
    return AxisCheck(axis=axis, verdict="not_told", sentence=why)


def _no_verdict(why: str) -> MountVerdict:
    return MountVerdict("not_told", why, [_not_told(axis, why) for axis in SHARED_DEG])
