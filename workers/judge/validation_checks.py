"""The check of a result on data that it was not fitted to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, Final

from apexcal.documents.checks import Check, CheckTopic
from workers.validation.road_verdict import contradiction

_ELSEWHERE: Final = CheckTopic("elsewhere", "Other recordings")
_NOUNS: Final = {"edges": "Depth edges", "lanes": "Lane markers"}


def elsewhere(validations: Sequence[Mapping[str, Any]]) -> Check:
    """Whether validations on other data agree with the result. Two that contradict each other on one drive do not
    count."""
    if not validations:
        return _ELSEWHERE.not_checked(
            "No validation tested the result on other data.",
            "Validate it on pairs of another recording, or on lanes and edges of a drive.",
        )
    contradictions, doubtful = _contradictions(validations)
    verdicts = [
        "unknown" if number in doubtful else validation["verdict"] for number, validation in enumerate(validations)
    ]
    figures = {verdict: float(verdicts.count(verdict)) for verdict in ("agrees", "disagrees", "unknown")}
    against = [
        validation["sentence"]
        for validation, verdict in zip(validations, verdicts, strict=True)
        if verdict == "disagrees"
    ]
    if not against and not figures["agrees"]:
        return _ELSEWHERE.not_checked(
            " ".join(contradictions) or f"{len(verdicts)} validations on other data gave no verdict.",
            "Validate it on other data.",
            **figures,
        )
    agree = f"{figures['agrees']:.0f} of {len(verdicts)} validations on other data agree, none disagrees."
    return _ELSEWHERE.fails(
        "stop" if against else "pass",
        " ".join([*(against or [agree]), *contradictions]),
        "Check whether the camera moved since, and calibrate again.",
        **figures,
    )


def _contradictions(validations: Sequence[Mapping[str, Any]]) -> tuple[list[str], set[int]]:
    """Sentences about validations of one drive that contradict each other, and the numbers of these."""
    sentences: list[str] = []
    doubtful: set[int] = set()
    for (i, first), (j, second) in combinations(enumerate(validations), 2):
        is_of_one_drive = first.get("recording_id") and first["recording_id"] == second.get("recording_id")
        if not is_of_one_drive or "unknown" in (first["verdict"], second["verdict"]):
            continue
        if turns := contradiction(first, second):
            kinds = f"{_NOUNS[first['kind']]} and {_NOUNS[second['kind']].lower()}"
            sentences.append(f"{kinds} of {first['data']} contradict each other, so they give no verdict: {turns}.")
            doubtful |= {i, j}
    return sentences, doubtful
