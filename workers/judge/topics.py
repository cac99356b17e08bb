"""The rates at which checks may fail by chance, and the topics of checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from apexcal.documents.checks import USE_LIMIT_PX, USE_LIMIT_RAD, CheckVerdict
from apexcal.documents.pairs import CONFIRMED, MACHINE
from workers.judge.effects import Effect

LOOK_RATE: Final = 1.0 / 200.0
STOP_RATE: Final = 1.0 / 1000.0
"""Shares of sound results that a check of chance may call `look` and `stop`. A result has some fifteen checks, so
that at least 0.92 of sound results pass all of them, and at most 0.015 are stopped."""
HALF: Final = 0.5
"""Share of what use allows from which an effect is worth a look: with an independent one of the same size a point is
off by 0.7 of it."""


def graded(probability: float, effect: Effect) -> CheckVerdict:
    """Return the verdict on a cause: how often chance shows one like it, and what it does to points of use.

    It stops a result only if its effect surely exceeds what use allows.
    """
    if probability < STOP_RATE and effect.at_least > 1.0:
        return "stop"
    return "look" if probability < LOOK_RATE and effect.estimate > HALF else "pass"


def more_corners(pairs: Mapping[str, Sequence[Any]], missing: int = 0) -> str:
    """Return how a sentence begins that asks for more pairs: by people, or of a recording that the machine marks."""
    is_unattended = all(pairs.get(MACHINE) or (False,)) and not any(pairs.get(CONFIRMED, ()))
    if is_unattended:
        return "Record more poses of the board"
    return f"Mark {f'{missing} ' if missing else ''}more corner{'' if missing == 1 else 's'}"


def over_use(off_px: float, focal_px: float) -> float:
    """Return a displacement in the image, px, over what use allows under a lens of this focal length, px."""
    return off_px / max(USE_LIMIT_PX, USE_LIMIT_RAD * focal_px)
