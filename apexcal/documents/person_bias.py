"""A person's bias: the mean difference of their blind marks from the machine's, a habit of aiming."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import fmean, variance
from typing import Any, Final, NamedTuple

from apexcal.documents.pairs import MACHINE, MACHINE_OFF, MARK_SIGMA, MARKED_BY

_LEAST_MARKS: Final = 5  # as few tell no habit
SHARED: Final = 0.57
"""How far off the mean of the machine's marks is, against what a mark states: the root mean square of eight rendered
scenes of boards with rims (`benchmarks/marks`, `rims` and `all three`, seeds 9000 to 9003; 0.33 to 0.71 of each)."""


class PersonOffset(NamedTuple):
    """A person's number, the mean of that person's marks minus the machine's, px, and its variance per coordinate."""

    person: int
    u: float
    v: float
    variance: float

    @property
    def square(self) -> float:
        """Mean square over both coordinates, px^2, less what chance adds; below zero where that is more."""
        return 0.5 * (self.u**2 + self.v**2) - self.variance


def person_offsets(pairs: Mapping[str, Sequence[Any]]) -> list[PersonOffset]:
    """Return the offset of each person who alone marked at least five corners that the machine marked too.

    pairs: columns of a set, of which `marked_by` and `machine_off_px` may be missing.
    """
    by_person: dict[int, list[Sequence[float]]] = {}
    for people, off in zip(pairs.get(MARKED_BY, ()), pairs.get(MACHINE_OFF, ()), strict=False):
        if off is not None and len(people) == 1:
            by_person.setdefault(people[0], []).append(off)
    return [
        PersonOffset(
            person,
            -fmean(off[0] for off in offs),
            -fmean(off[1] for off in offs),
            0.5 * (variance(off[0] for off in offs) + variance(off[1] for off in offs)) / len(offs),
        )
        for person, offs in sorted(by_person.items())
        if len(offs) >= _LEAST_MARKS
    ]


def person_px(pairs: Mapping[str, Sequence[Any]], habit_px: float, alone_px: float) -> float:
    """Return the deviation of a person's shift per coordinate, px: the habit of aiming, or what these people show.

    The machine's is a share of what its marks state: rims and shadows shift all of them alike.

    habit_px: what is assumed of people of whom nothing shows more; alone_px: of one who marked alone, unseen by
    others and by the machine.
    """
    offsets = person_offsets(pairs)
    shown = max(fmean(offset.square for offset in offsets), 0.0) if offsets else 0.0
    machine = pairs.get(MACHINE) or [False] * len(pairs.get(MARKED_BY, ()))
    rows = zip(pairs.get(MARKED_BY, ()), machine, strict=False)
    people = {person for markers, is_machine in rows for person in markers if not is_machine}
    variance = max(habit_px**2, shown)
    of_people = variance if offsets or len(people) != 1 else alone_px**2
    of_machine = zip(pairs.get(MACHINE, ()), pairs.get(MARK_SIGMA, ()), strict=False)
    each = [
        max(variance, (SHARED * (sigma or 0.0)) ** 2) if is_machine else of_people for is_machine, sigma in of_machine
    ]
    return (fmean(each) if each else of_people) ** 0.5
