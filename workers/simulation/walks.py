"""Ways to walk through the field: where the person goes, how fast, and how the board moves in their hands."""

# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from apexcal.documents.simulation import WalkName

Floats = NDArray[np.float64]
Sines = tuple[tuple[float, ...], tuple[float, ...]]

_TICK_S = 0.05
FIELD_X_M = (4.0, 32.0)
FIELD_HALF_WIDTH_M = 5.0
YARD_FAR_M = 14.0
_ROW_M = 1.5
_VIEW_DEG = 50.0  # to either side: farther out neither sensor looks


@dataclass(frozen=True, slots=True)
class WalkPlan:
    """A named walk.

    Attributes:
        line: random generator and length (m) -> the way (K, 2) in steps of about 2 cm, and pace (K,) in metres per
            second at each of its points.
        raises, yaws, rolls, tilts, bobs: rates (Hz) and amplitudes (metres for raises and bobs, else degrees)
            of the sines that make the board's motion.
    """

    line: Callable[[np.random.Generator, float], tuple[Floats, Floats]]
    raises: Sines = ((0.1, 0.23), (0.64, 0.04))
    yaws: Sines = ((0.11, 0.37, 0.9), (5.0, 3.0, 1.0))
    rolls: Sines = ((0.17, 0.45, 1.1), (2.5, 1.5, 0.6))
    tilts: Sines = ((0.14, 0.5), (1.5, 0.8))
    bobs: Sines = ((1.7,), (0.008,))


def walked(plan: WalkPlan, random: np.random.Generator, seconds: float) -> tuple[Floats, Floats]:
    """Even ticks (T,) in seconds and the walker's smooth path (T, 2) over at least ``seconds``."""
    line, pace = plan.line(random, seconds)
    length = np.linalg.norm(np.diff(line, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(length / pace[:-1])])
    ticks = np.arange(0.0, seconds + 1.0, _TICK_S)
    # Starts a second into the path: smoothing bends its ends.
    turn = np.mod(ticks + 1.0, at[-1])
    xy = np.column_stack([np.interp(turn, at, line[:, axis]) for axis in range(2)])
    smooth: Floats = gaussian_filter1d(xy, 0.4 / _TICK_S, axis=0, mode="nearest")
    return ticks - 0.5, smooth


def _stepped(corners: Floats) -> Floats:
    """The straight legs between the corners in steps of at most 2 cm."""
    steps: list[Floats] = []
    for start, end in pairwise(corners):
        count = max(2, int(np.ceil(np.linalg.norm(end - start) / 0.02)))
        steps.append(start + (end - start) * np.linspace(0.0, 1.0, count, endpoint=False)[:, None])
    return np.concatenate(steps)


def _rows(random: np.random.Generator, seconds: float) -> tuple[Floats, Floats]:
    """A serpentine over 3.2-30 m: rows across the field, each as wide as the field or the sensors' view allows.

    Slow where near, because there the apex moves fast in the image while the nearest frame is up to half a
    frame away, and because far away few rings meet the board. Far to both sides, because only there do the terms of
    a lens tell yaw from c_x.
    """
    side = float(random.choice([-1.0, 1.0]))
    points: list[tuple[float, float]] = []
    for x in (3.2, 3.9, 4.7, 5.6, 7.5, 11.0, 29.5):
        half_width = min(FIELD_HALF_WIDTH_M, x * np.tan(np.deg2rad(_VIEW_DEG)))
        points += [(x, side * half_width), (x, -side * half_width)]
        side = -side
    line = _stepped(np.array(points) + random.uniform(-0.15, 0.15, (len(points), 2)))
    line = np.concatenate([line, line[::-1]])  # there and back, so that a long walk repeats without a jump
    return line, np.clip(0.016 * np.sum(line**2, axis=1), 0.4, 2.0)


def _all_over(random: np.random.Generator, seconds: float) -> tuple[Floats, Floats]:
    """Row by row over the whole field to its edges, away and back again until the time is over, 0.9 to 1.4 m/s."""
    points: list[tuple[float, float]] = []
    legs: list[Floats] = []
    away, side, walked_s = True, float(random.choice([-1.0, 1.0])), 0.0
    paces: list[Floats] = []
    while walked_s < seconds + 5.0:
        rows = np.arange(FIELD_X_M[0], FIELD_X_M[1], _ROW_M) + random.uniform(0.0, _ROW_M)
        rows = np.concatenate([FIELD_X_M[:1], rows[rows < FIELD_X_M[1]]])
        points = points[-1:]
        for x in rows if away else rows[::-1]:
            half_width = min(FIELD_HALF_WIDTH_M, x * np.tan(np.deg2rad(_VIEW_DEG)))
            points += [(x, side * half_width), (x, -side * half_width)]
            side = -side
        leg = _stepped(np.array(points))
        pace = random.uniform(0.9, 1.4)
        legs.append(leg)
        paces.append(np.full(len(leg), pace))
        walked_s += 0.02 * len(leg) / pace
        away = not away
    return np.concatenate(legs), np.concatenate(paces)


def _anywhere(
    slowest: float, fastest: float, far_m: float = FIELD_X_M[1]
) -> Callable[[np.random.Generator, float], tuple[Floats, Floats]]:
    """Make a walk between random places of the field, up to ``far_m``, each leg at its own pace (m/s)."""

    def line(random: np.random.Generator, seconds: float) -> tuple[Floats, Floats]:
        places = [_place(random, far_m)]
        paces: list[Floats] = []
        legs: list[Floats] = []
        remaining = seconds + 5.0
        while remaining > 0.0:
            places.append(_place(random, far_m))
            leg = _stepped(np.array(places[-2:]))
            pace = random.uniform(slowest, fastest)
            legs.append(leg)
            paces.append(np.full(len(leg), pace))
            remaining -= float(np.linalg.norm(places[-1] - places[-2])) / pace
        return np.concatenate(legs), np.concatenate(paces)

    return line


def _place(random: np.random.Generator, far_m: float) -> Floats:
    """Uniform over the field where the sensors look."""
    while True:
        xy = np.array([random.uniform(FIELD_X_M[0], far_m), random.uniform(-FIELD_HALF_WIDTH_M, FIELD_HALF_WIDTH_M)])
        if abs(xy[1]) < xy[0] * np.tan(np.deg2rad(_VIEW_DEG)):
            return xy


def _spot(random: np.random.Generator, seconds: float) -> tuple[Floats, Floats]:
    """One place, 5 to 10 m ahead: a line of 2 mm that takes longer than the walk."""
    xy = np.array([random.uniform(5.0, 10.0), random.uniform(-2.0, 2.0)])
    line = xy + np.linspace(0.0, 0.002, 20)[:, None] * np.array([0.0, 1.0])
    return line, np.full(len(line), 0.002 / (seconds + 5.0))


_STUDY_ROLLS: Sines = ((0.17, 0.45, 1.1), (4.0, 2.5, 1.4))  # standard deviation 3.5 degrees

WALKS: dict[WalkName, WalkPlan] = {
    "rows": WalkPlan(_rows),
    "field": WalkPlan(_anywhere(0.7, 1.6), rolls=_STUDY_ROLLS),
    "cover": WalkPlan(_all_over, rolls=_STUDY_ROLLS),
    "yard": WalkPlan(_anywhere(0.5, 1.4, YARD_FAR_M), rolls=_STUDY_ROLLS),
    "slow": WalkPlan(_anywhere(0.15, 0.3), rolls=_STUDY_ROLLS),
    "still": WalkPlan(
        _spot,
        raises=((0.1, 0.23), (0.004, 0.002)),
        yaws=((0.11, 0.37, 0.9), (0.3, 0.2, 0.1)),
        rolls=((0.17, 0.45, 1.1), (0.3, 0.2, 0.1)),
        tilts=((0.14, 0.5), (0.2, 0.1)),
        bobs=((1.7,), (0.001,)),
    ),
}
