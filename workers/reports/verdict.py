"""The verdict on a result: one sentence, and the reasons for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from apexcal.documents.checks import Check, CheckVerdict, verdict_of
from apexcal.documents.results import FitResult


class ReportVerdict(NamedTuple):
    """How far to trust a result. ``against`` are reasons not to use it, ``doubts`` reasons to look first."""

    level: CheckVerdict
    sentence: str
    against: list[str]
    doubts: list[str]


def sentence_of(result: FitResult, checks: Sequence[Check]) -> ReportVerdict:
    """Return what the checks of the mount with its lens come to."""
    concerned = [check for check in checks if check.scope == "mount_with_lens"]
    against = [check.sentence for check in concerned if check.verdict == "stop"]
    doubts = [check.sentence for check in concerned if check.verdict == "look"]
    level = verdict_of(concerned, "mount_with_lens")
    words = {
        "stop": f"Do not use it as it is: {_counted(len(against), 'check says', 'checks say')} so",
        "look": f"Look at it before you use it: {_counted(len(doubts), 'check asks', 'checks ask')} for that",
        "pass": "It passes all checks",
    }[level]
    return ReportVerdict(level, f"{words}. {_precision(result)}", against, doubts)


def _counted(count: int, singular: str, many: str) -> str:
    return f"1 {singular}" if count == 1 else f"{count} {many}"


def _precision(result: FitResult) -> str:
    """What to expect of it at 20 m in the middle of the image."""
    off = f"Its pairs lie {result.polished.mean_px:.2f} px off on average"
    middle = result.prediction and result.prediction.middle_at(20.0)
    if not middle:
        return f"{off}."
    px, mm = middle
    return (
        f"{off}; a point at 20 m in the middle of the image is placed within {px:.2f} px or {mm:.0f} mm (one "
        "standard deviation)."
    )
