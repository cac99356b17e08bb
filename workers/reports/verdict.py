"""The verdict on a result: one sentence, and the reasons for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from apexcal.documents.checks import Check
from apexcal.documents.reports import VerdictLevel


class Verdict(NamedTuple):
    """How far to trust a result. ``against`` are reasons not to use it, ``doubts`` reasons to look first."""

    level: VerdictLevel
    sentence: str
    against: list[str]
    doubts: list[str]


def verdict_of(document: dict[str, Any], objections: Sequence[str], checks: Sequence[Check]) -> Verdict:
    """``objections``: what speaks against publishing the result. Checks of the mount alone do not count."""
    concerned = [one for one in checks if one.scope == "mount_with_lens"]
    against = list(objections)
    against += [one.sentence for one in concerned if one.verdict == "stop" and not _is_said(one.sentence, against)]
    doubts = [one.sentence for one in concerned if one.verdict == "look" and not _is_said(one.sentence, against)]
    level: VerdictLevel = "unsound" if against else "doubtful" if doubts else "sound"
    words = {
        "unsound": f"Do not use it as it is: {_counted(len(against), 'reason speaks', 'reasons speak')} against it",
        "doubtful": f"Check it before you use it: {_counted(len(doubts), 'reason', 'reasons')} for doubt",
        "sound": "Nothing speaks against it",
    }[level]
    return Verdict(level, f"{words}. {_precision(document)}", against, doubts)


def _is_said(sentence: str, others: Sequence[str]) -> bool:
    return any(sentence in one or one in sentence for one in others)


def _counted(count: int, one: str, many: str) -> str:
    return f"1 {one}" if count == 1 else f"{count} {many}"


def _precision(document: dict[str, Any]) -> str:
    """What to expect of it at 20 m in the middle of the image."""
    prediction = document.get("prediction") or {}
    points = prediction.get("points") or []
    middle = points[len(points) // 2] if points else {}
    if not middle.get("stated_px"):
        return f"Its pairs lie {document['polished']['mean_px']:.2f} px off on average."
    at = prediction["distances_m"].index(20.0)
    factor = prediction["expected_over_stated"]
    px, mm = (factor * middle[name][at] for name in ("stated_px", "stated_mm"))
    return (
        f"Its pairs lie {document['polished']['mean_px']:.2f} px off on average; a point at 20 m in the middle of "
        f"the image is placed within {px:.2f} px or {mm:.0f} mm (one standard deviation)."
    )
