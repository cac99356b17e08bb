"""Checks of a result: what was looked at, what came of it, and what to do. They are all that anybody judges it by."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Final, Literal

from apexcal.documents.base import Document

CheckVerdict = Literal["pass", "look", "stop"]
CheckOutcome = Literal["pass", "not_checked", "look", "stop"]
CheckScope = Literal["mount_with_lens", "mount_alone"]
RequiredCheck = Literal[
    "clock", "rolling_shutter", "stated_lens", "shared_errors", "halves", "models", "rig", "elsewhere", "sensors"
]
"""Checks that a publication policy may require to have been made."""


class Check(Document):
    """One check of a result.

    ``verdict``: ``look`` if a person should look before the result is used, ``stop`` if it should not be used,
    ``not_checked`` if nothing could test it, which speaks neither for nor against the result, else ``pass``.
    ``sentence`` says what was found, ``figures`` are its numbers by name (unit in the name: ``_px``, ``_deg``), null
    where the pairs do not tell them. ``remedy`` says what to do, of ``not_checked`` what would check it, and is empty
    where the check passes. ``scope``: ``mount_alone`` concerns only those who use the mount with another lens than
    the result's.
    """

    name: str
    title: str
    verdict: CheckOutcome
    sentence: str
    remedy: str
    figures: dict[str, float | None]
    scope: CheckScope

    @property
    def is_doubt(self) -> bool:
        """Whether it speaks against the result: ``look`` or ``stop``."""
        return self.verdict in ("look", "stop")


@dataclass(frozen=True)
class CheckTopic:
    """The topic of a check: its name, its title, and whom it concerns."""

    name: str
    title: str
    scope: CheckScope = "mount_with_lens"

    def passes(self, sentence: str, **figures: float | None) -> Check:
        """Return the check with nothing to do. ``sentence``: what is."""
        return self.fails("pass", sentence, "", **figures)

    def not_checked(self, sentence: str, would_check: str, **figures: float | None) -> Check:
        """Return the check that was not made. ``sentence``: why not; ``would_check``: what it takes."""
        return self.fails("not_checked", sentence, would_check, **figures)

    def fails(self, verdict: CheckOutcome, sentence: str, remedy: str, **figures: float | None) -> Check:
        """Return the check with a remedy, which a verdict of ``pass`` drops."""
        return Check(
            name=self.name,
            title=self.title,
            verdict=verdict,
            sentence=sentence,
            remedy="" if verdict == "pass" else remedy,
            figures=figures,
            scope=self.scope,
        )


USE_LIMIT_PX: Final = 2.0
USE_LIMIT_RAD: Final = 1.5e-3
"""A projected point may be off by the larger of both: two pixels are what a detection in the image is good to, and
1.5 mrad are 3 cm at 20 m, the width of a LiDAR's beam there."""
USE_LIMIT_M: Final = 0.0146
"""Near the sensor it may be off by the width of a beam at 5 m. The beam leaves the sensor 9.5 mm wide (data sheets of
OS1 and VLP-16). No board tells more: its edges are known to 3.5 mm, its tip less well."""
ALONE_LIMIT_DEG: Final = 0.4
ALONE_LIMIT_MM: Final = 40.0
"""95 % half-widths that a mount may have if it is used with another lens. At 5 m a turn of 0.4 degrees moves a point
by 35 mm, about as far as the shift does."""
# Made by the workers, and looked up by the policy.
MARKS_CONFIRMED: Final = CheckTopic("marks_confirmed", "Marks seen by people")


def figure(value: float, digits: int = 2) -> str:
    """Return a number for a sentence, with so many significant digits and no exponent: 0.0012, 54, 110."""
    return format(Decimal(f"{value:.{digits}g}"), "f")


def alone_over_limits(half_width_deg: float, half_width_mm: float) -> tuple[float, float]:
    """Return the half-widths of a mount's turn and shift over those that it may have with another lens."""
    return half_width_deg / ALONE_LIMIT_DEG, half_width_mm / ALONE_LIMIT_MM


def later_checks(checks: Sequence[Check], later: Sequence[Check]) -> list[Check]:
    """Return both; a later check replaces an earlier one of its name."""
    names = {check.name for check in later}
    return [*(check for check in checks if check.name not in names), *later]


def doubts_of(checks: Iterable[Check]) -> list[Check]:
    """Return the checks of `look` and `stop`, the gravest first; those of the mount alone are left out."""
    of_use = [check for check in checks if check.scope == "mount_with_lens" and check.is_doubt]
    return sorted(of_use, key=lambda check: check.verdict != "stop")


def verdict_of(checks: Iterable[Check], scope: CheckScope) -> CheckVerdict:
    """Return the gravest verdict of the checks that concern this use: all of them for the mount alone.

    What was not checked is no doubt.
    """
    verdicts = {check.verdict for check in checks if scope == "mount_alone" or check.scope == scope}
    return "stop" if "stop" in verdicts else "look" if "look" in verdicts else "pass"
