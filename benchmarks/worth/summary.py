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
        "label": question.label,
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
            **_before_polish(name, points),
            "seconds": round(float(np.mean([rig["ways"][name]["seconds"] for rigs in points for rig in rigs])), 4),
        }
    return found | {"optimum": _optimum(points)} | _by_model(question, points)


def wilson(hits: int, tries: int) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    interval: Any = stats.binomtest(hits, tries).proportion_ci(method="wilson")
    return round(float(interval.low), 4), round(float(interval.high), 4)


def share(hits: Sequence[bool]) -> float:
    """How many of them are true, from 0 to 1."""
    return round(float(np.mean(hits)), 4)


def _before_polish(name: str, points: Sequence[Sequence[dict[str, Any]]]) -> dict[str, Any]:
    key = "right_before_polish"
    if key not in points[0][0]["ways"][name]:
        return {}
    return {key: [share([rig["ways"][name][key] for rig in rigs]) for rigs in points]}


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


def _by_model(question: Question, points: Sequence[Sequence[dict[str, Any]]]) -> dict[str, Any]:
    if len(question.models) == 1:
        return {}
    found: dict[str, Any] = {}
    for model in question.models:
        own = [[rig for rig in rigs if rig["model"] == model] for rigs in points]
        found[model] = {
            name: [share([rig["ways"][name]["success"] for rig in rigs]) if rigs else None for rigs in own]
            for name in METHODS
        }
        found[model]["optimum_right"] = [share([rig["right"] for rig in rigs]) if rigs else None for rigs in own]
    return {"by_model": found}
