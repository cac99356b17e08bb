"""Make one answer of several people's opinions on a vertex. Pure functions: no database.

The rules, in the order in which they are applied:

- ``unsure`` counts neither way, and its mark, if there is one, is not used.
- More rejections than confirmations remove the vertex. As many of both keep it and flag it.
- The correspondence is the only mark, the mean of two, the geometric median of more. Two that lie far apart give
  none: one of them is wrong, and so is their mean.
- A vertex that nobody both confirmed and marked gives no correspondence.
- An answer that was given after its person was told something of others' answers (``reviewed``) has a vote and a mark
  as all have, because reviewing means correcting what one sees. It is not independent: the number of marks and their
  spread are those of the other answers alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple
from uuid import UUID

Pixel = tuple[float, float]


class ConsensusOutcome(StrEnum):
    """The outcome for a vertex."""

    KEPT = "kept"
    TIED = "tied"  # kept and flagged
    REMOVED = "removed"
    UNMARKED = "unmarked"
    APART = "apart"  # two marks that cannot both be of this vertex


class MachineShare(NamedTuple):
    """Deviation of the machine's mark (px per coordinate), and the side of the crop on which it is shown (px)."""

    sigma_px: float
    side_px: float


# The machine is one person, whose marks are all off by one shift.
MACHINE = UUID(int=0)


@dataclass(frozen=True, slots=True)
class Opinion:
    """One person's verdict on a vertex, and the mark (u, v) in pixels that belongs to it, if there is one.

    ``reviewed``: the person knew something of others' answers. ``person``: whose verdict it is.
    ``machine``: the mark is the machine's.
    """

    verdict: str
    mark: Pixel | None = None
    reviewed: bool = False
    person: UUID | None = None
    machine: MachineShare | None = None


@dataclass(frozen=True, slots=True)
class Consensus:
    """The answer that the opinions give together.

    Attributes:
        outcome: kept, tied (kept and flagged), removed, unmarked or apart.
        pixel: (u, v) of the correspondence; None where there is none.
        spread_px: root mean square distance of the independent marks from their own middle; 0 for one or none, None
            without ``pixel``.
        marks: how many independent marks ``pixel`` stands on.
        answers: how many people said anything, ``unsure`` included.
        reviewed: how many of them had been told something of others' answers.
    """

    outcome: ConsensusOutcome
    pixel: Pixel | None
    spread_px: float | None
    marks: int
    answers: int
    reviewed: int


def far_apart_px(width: int, height: int) -> float:
    """Distance beyond which two marks cannot be of one vertex: a hundredth of the image's diagonal.

    The robust loss of the fit saturates there, far above a mark's noise and far below a wrong corner.
    """
    return 0.01 * math.hypot(width, height)


def agree(opinions: Sequence[Opinion], apart_px: float = math.inf) -> Consensus:
    """Make one answer of all opinions on a vertex. Their order does not matter, to the last bit.

    ``apart_px``: two marks farther from each other give no correspondence.
    """
    confirming = [opinion for opinion in opinions if opinion.verdict == "confirmed"]
    rejected = sum(opinion.verdict == "rejected" for opinion in opinions)
    answers, reviewed = len(opinions), sum(opinion.reviewed for opinion in opinions)
    if rejected > len(confirming):
        return Consensus(ConsensusOutcome.REMOVED, None, None, 0, answers, reviewed)
    marks = [opinion.mark for opinion in confirming if opinion.mark]
    if not marks:
        return Consensus(ConsensusOutcome.UNMARKED, None, None, 0, answers, reviewed)
    independent = sorted(opinion.mark for opinion in confirming if opinion.mark and not opinion.reviewed)
    if len(marks) == 2 and _distance(*marks) > apart_px:
        return Consensus(ConsensusOutcome.APART, None, None, len(independent), answers, reviewed)
    outcome = ConsensusOutcome.TIED if rejected == len(confirming) else ConsensusOutcome.KEPT
    return Consensus(outcome, combine(marks), _spread(independent), len(independent), answers, reviewed)


def _spread(marks: Sequence[Pixel]) -> float:
    if not marks:
        return 0.0
    middle = combine(marks)
    return math.sqrt(sum(_distance(mark, middle) ** 2 for mark in marks) / len(marks))


def combine(marks: Sequence[Pixel]) -> Pixel:
    """One mark itself, the mean of two, the geometric median of more.

    Raises:
        ValueError: there is no mark.
    """
    if not marks:
        raise ValueError("there is no mark to combine")
    ordered = sorted(marks)
    return _mean(ordered) if len(ordered) <= 2 else geometric_median(ordered)


def geometric_median(points: Sequence[Pixel]) -> Pixel:
    """The point with the smallest sum of distances to ``points`` (pixels), the same for every order of them.

    First the points themselves: p is a median exactly where the unit vectors to the others add up to no more than
    p's own multiplicity (Kuhn 1973). Where several are (an even number of points on a line) all between them is
    a median, and their mean is taken. Otherwise the sum is smooth and strictly convex about its minimum:
    Weiszfeld's iteration comes near, Newton's ends it to the precision of the numbers.
    """
    ordered = [complex(*point) for point in sorted(points)]
    medians = [point for i, point in enumerate(ordered) if point not in ordered[:i] and _is_median(point, ordered)]
    if medians:
        return _mean([(median.real, median.imag) for median in medians])
    guess = sum(ordered) / len(ordered)
    for _ in range(200):
        steps = [_weiszfeld_step(guess, ordered), *_newton_steps(guess, ordered)]
        moved = min(steps, key=lambda step: math.fsum(abs(point - step) for point in ordered))
        if abs(moved - guess) <= 1e-13 * (1.0 + abs(guess)):
            break
        guess = moved
    return guess.real, guess.imag


def _is_median(point: complex, points: Sequence[complex]) -> bool:
    away = [other - point for other in points if other != point]
    pull = abs(sum(offset / abs(offset) for offset in away))
    # A margin of a few ulp: with points on a line the pull is 1 up to rounding.
    return pull <= len(points) - len(away) + 1e-12 * len(points)


def _weiszfeld_step(guess: complex, points: Sequence[complex]) -> complex:
    """Weiszfeld 1937, with the step of Vardi and Zhang 2000 where the guess meets one of the points."""
    away = [point - guess for point in points if point != guess]
    pull = sum(offset / abs(offset) for offset in away)
    stay = min(1.0, (len(points) - len(away)) / abs(pull)) if pull else 1.0
    return guess + (1.0 - stay) * pull / sum(1.0 / abs(offset) for offset in away)


def _newton_steps(guess: complex, points: Sequence[complex]) -> list[complex]:
    """Newton's step and shortened ones (the sum has kinks at the points); none where it is undefined.

    With unit vectors e at distances d, the step s solves: sum of (s - e Re(e* s)) / d = sum of e.
    """
    if guess in points:
        return []
    away = [point - guess for point in points]
    pull = sum(offset / abs(offset) for offset in away)
    whole = sum(1.0 / abs(offset) for offset in away)
    turned = sum(offset * offset / abs(offset) ** 3 for offset in away)
    determinant = whole * whole - abs(turned) ** 2
    if determinant <= 0.0:
        return []
    step = 2.0 * (whole * pull + turned * pull.conjugate()) / determinant
    return [guess + step / 4**k for k in range(8)]


def _mean(points: Sequence[Pixel]) -> Pixel:
    return (
        math.fsum(point[0] for point in points) / len(points),
        math.fsum(point[1] for point in points) / len(points),
    )


def _distance(a: Pixel, b: Pixel) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])
