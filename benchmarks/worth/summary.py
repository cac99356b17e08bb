"""Shares with their intervals, out of what single rigs told."""

# pyright: reportMissingTypeStubs=false
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.worth.methods import METHODS
from benchmarks.worth.questions import Question


def curve(question: Question, points: Sequence[Sequence[dict[str, Any]]]) -> dict[str, Any]:
    """The numbers of one question: for every method a list along the values, and what the optimum is worth."""
    found: dict[str, Any] = {
        "values": list(question.values),
        "rigs": [len(rigs) for rigs in points],
    }
    for name in METHODS:
        success = [[rig["ways"][name]["success"] for rig in rigs] for rigs in points]
        intervals = [wilson(sum(hits), len(hits)) for hits in success]
        found[name] = {
            "success": [share(hits) for hits in success],
            "low95": [low for low, _ in intervals],
            "high95": [high for _, high in intervals],
            "right": [share([rig["ways"][name]["right"] for rig in rigs]) for rigs in points],
            "seconds": round(float(np.mean([rig["ways"][name]["seconds"] for rigs in points for rig in rigs])), 4),
        }
    return found | {"optimum": _optimum(points)}


def wilson(hits: int, tries: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    interval: Any = stats.binomtest(hits, tries).proportion_ci(method="wilson")
    return round(float(interval.low), 4), round(float(interval.high), 4)


def share(hits: Sequence[bool]) -> float:
    """How many of them are true, from 0 to 1."""
    return round(float(np.mean(hits)), 4)


def _optimum(points: Sequence[Sequence[dict[str, Any]]]) -> dict[str, Any]:
    def medians(key: str) -> list[float]:
        return [round(float(np.median([rig[key] for rig in rigs])), 4) for rigs in points]

    worth: dict[str, Any] = {key: medians(key) for key in ("field_error_px", "turn_error_deg", "place_error_m")}
    worth |= {key: [share([rig[key] for rig in rigs]) for rigs in points] for key in ("right", "beaten")}
    if all(rig["known"] is not None for rigs in points for rig in rigs):
        worth["mount_stated_known"] = [share([rig["known"] for rig in rigs]) for rigs in points]
        worth["stated_known_but_wrong"] = [
            share([rig["known"] and not rig["right"] for rig in rigs]) for rigs in points
        ]
    return worth
