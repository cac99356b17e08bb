"""The check of a result on data that it was not fitted to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from apexcal.documents.checks import Check, CheckTopic

_ELSEWHERE: Final = CheckTopic("elsewhere", "Other recordings")


def elsewhere(validations: Sequence[Mapping[str, Any]]) -> Check:
    """Whether validations on other data agree with the result."""
    if not validations:
        return _ELSEWHERE.not_checked(
            "No validation tested the result on other data.",
            "Validate it on pairs of another recording, or on lanes and edges of a drive.",
        )
    verdicts = [one["verdict"] for one in validations]
    figures = {verdict: float(verdicts.count(verdict)) for verdict in ("agrees", "disagrees", "unknown")}
    against = [one["sentence"] for one in validations if one["verdict"] == "disagrees"]
    if not against and not figures["agrees"]:
        return _ELSEWHERE.not_checked(
            f"{len(verdicts)} validations on other data could not tell.", "Validate it on other data.", **figures
        )
    return _ELSEWHERE.fails(
        "stop" if against else "pass",
        " ".join(against)
        or f"{figures['agrees']:.0f} of {len(verdicts)} validations on other data agree, none disagrees.",
        "Check whether the camera moved since, and calibrate again.",
        **figures,
    )
