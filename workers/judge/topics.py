"""How often a check may fail by chance, and what it fails for."""

from __future__ import annotations

from typing import Final

from apexcal.documents.checks import USE_LIMIT_PX, USE_LIMIT_RAD, CheckVerdict

LOOK_RATE: Final = 1.0 / 200.0
STOP_RATE: Final = 1.0 / 1000.0
"""Shares of sound results that a check of chance may call `look` and `stop`. A result has some fifteen checks, so
that at least 0.92 of sound results pass all of them, and at most 0.015 are stopped."""
MATTERS: Final = 0.5
"""What a check finds matters if it is larger than this share of a mark's noise: added to the noise in squares, it
then is an eighth of it. Half as much is worth a look."""


def graded(probability: float, size: float, limit: float) -> CheckVerdict:
    """Return the verdict on an effect: how often chance shows one like it, and its size, which matters at `limit`."""
    if probability < STOP_RATE and size > limit:
        return "stop"
    return "look" if probability < LOOK_RATE and size > 0.5 * limit else "pass"


def is_grave(off_px: float, focal_px: float) -> bool:
    """Whether a displacement in the image, px, exceeds what use allows under a lens of this focal length, px."""
    return off_px > max(USE_LIMIT_PX, USE_LIMIT_RAD * focal_px)
