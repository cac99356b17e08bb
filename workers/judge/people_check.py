"""The check of the people who marked: whether a person aims beside the corner."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from scipy import special

from apexcal.documents.checks import USE_LIMIT_PX, USE_LIMIT_RAD, Check, CheckTopic, figure
from apexcal.documents.pairs import MACHINE
from apexcal.documents.person_bias import PersonOffset, person_offsets
from apexcal.documents.results import FitResult
from workers.judge.effects import Effect
from workers.judge.topics import LOOK_RATE, graded

_PEOPLE: Final = CheckTopic("people", "How people aim")
_SURE: Final = 2.0  # standard deviations


def people(result: FitResult, pairs: Mapping[str, Sequence[Any]]) -> Check:
    """Whether a person's blind marks lie beside the machine's.

    The machine states how well it marks, so that a shift of a person's marks is that person's. If nothing shows it,
    the stated errors assume what `service/calibrations/pair_rules.py` has.
    """
    if pairs.get(MACHINE) and all(pairs[MACHINE]):
        return _PEOPLE.passes("No mark is a person's own.")
    offsets = person_offsets(pairs)
    several = result.person_bias is not None and result.person_bias.people > 1
    if not offsets:
        stated = result.common_errors.get("person_px", 0.0)
        alone = (
            "Only the differences between people show how far they aim beside the corner."
            if several
            else "One person marked, and nothing shows where that person aims beside the corner."
        )
        return _PEOPLE.not_checked(
            f"{alone} The stated errors assume {figure(stated)} px in u and in v.",
            "Let the machine mark the detection, and a second person.",
            person_px=stated,
        )
    lens, worst = result.intrinsics, max(offsets, key=lambda offset: offset.square)
    off_px, deviation_px = _size(worst), worst.variance**0.5
    limit_px = max(USE_LIMIT_PX, USE_LIMIT_RAD * (lens.f_x * lens.f_y) ** 0.5)
    at_least = max(off_px - _SURE * deviation_px, 0.0)
    effect = Effect(off_px / limit_px, at_least / limit_px, deviation_px / limit_px)
    # Two coordinates of one variance: the square of the length over it is chi-square with two degrees.
    deviations = off_px / deviation_px if deviation_px > 0.0 else np.inf if off_px > 0.0 else 0.0
    probability = min(len(offsets) * float(special.chdtrc(2.0, deviations**2)), 1.0)
    counted = result.person_bias.px if result.person_bias else 0.0
    return _PEOPLE.fails(
        graded(probability, effect),
        f"Marks of person {worst.person + 1} lie {figure(off_px)} ± {figure(deviation_px)} px from the machine's on "
        f"average (limit {figure(limit_px)} px; {worst.u:+.1f} px in u, {worst.v:+.1f} px in v). The stated errors "
        f"count {figure(counted)} px for each person."
        if probability < LOOK_RATE
        else f"No person's marks lie beside the machine's beyond chance: at most {figure(off_px)} px on average.",
        "Do this person and the machine aim at the corner? Look at their marks; let another person mark.",
        off_px=off_px,
        deviation_px=deviation_px,
        probability=probability,
        people=float(len(offsets)),
    )


def _size(offset: PersonOffset) -> float:
    return float((offset.u**2 + offset.v**2) ** 0.5)
