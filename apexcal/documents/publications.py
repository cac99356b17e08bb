"""Publications: requests to publish and to withdraw, and their outcomes."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, get_args
from uuid import UUID

from pydantic import AfterValidator, Field, StringConstraints

from apexcal.documents.base import Received, Sent, legible_text
from apexcal.documents.checks import MARKS_CONFIRMED, Check, RequiredCheck, verdict_of

_Most = Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]
_Share = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]


class PublicationPolicy(Received):
    """Limits, each optional, and what is published without a person. Members of the rig's policy replace the fleet's.

    Upper limits: ``heldout_mean_px`` of the mean error of held-out pairs; ``std_deg`` and ``std_mm`` of the largest
    standard deviation of a turn and of a component of the translation; ``halves_ratio`` of the difference between
    fits of two halves of the pairs, over its stated size. Lower limit: ``coverage``, the share of the image's 8 x 6
    equal cells that hold a pair. ``publish_looks``: whether a result with a check of ``look`` is published by itself
    too, where that was asked for; otherwise only one that passes all checks. ``publish_unattended``: whether a result
    of the machine's marks is published although nobody looked at them and no earlier result confirms them;
    ``publish_looks`` alone does not publish it. ``required_checks``: names of checks that must have been made; a
    check that was not made is no doubt otherwise.
    """

    heldout_mean_px: _Most | None = None
    std_deg: _Most | None = None
    std_mm: _Most | None = None
    halves_ratio: _Most | None = None
    coverage: _Share | None = None
    publish_looks: bool | None = None
    publish_unattended: bool | None = None
    required_checks: Annotated[list[RequiredCheck], Field(max_length=len(get_args(RequiredCheck)))] | None = None

    def publishes(self, checks: Sequence[Check]) -> bool:
        """Whether a recommended result with these checks is published by itself."""
        verdict = verdict_of(checks, "mount_with_lens")
        if any(check.name == MARKS_CONFIRMED.name and check.verdict != "pass" for check in checks):
            return False
        return verdict == "pass" or (verdict == "look" and bool(self.publish_looks))


# A sentence or two that whoever looks later can read.
Reason = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=500), AfterValidator(legible_text)
]


CURRENT = "current"
# It stands in addresses.
AliasName = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_.-]{0,63}$")]


class Override(Received):
    """Publish although a check says `stop`, and why."""

    reason: Reason


class PublicationRequest(Received):
    """The alias under which a result is published, and the reason. ``override`` is needed if a check says `stop`.

    The override is kept with the checks' sentences. A result that the alias led to before needs a reason.
    """

    alias: AliasName = CURRENT
    reason: Reason | None = None
    override: Override | None = None


class OverrideView(Sent):
    """Why a result was published all the same, and the sentences of the checks that it did not pass then."""

    reason: str
    sentences: list[str]


class WithdrawalRequest(Received):
    """Why a publication must no longer be used."""

    reason: Reason


class PublicationView(Sent):
    """A move of an alias of a vehicle's camera: to which result, by whom, when, why, and against which checks.

    ``number`` counts the alias's moves from 1. ``result_id`` is null if the result was deleted since, or the
    move is a withdrawal. ``led_to`` is the result's id, also after the result was deleted; null of a
    withdrawal. ``published_by`` is a name, null where the person is no longer known. ``reason`` is null where none
    was given. ``is_current``: the alias leads to this result now.
    """

    id: UUID
    fleet_id: UUID
    vehicle_id: UUID
    camera: str
    alias: str
    number: int
    result_id: UUID | None
    led_to: UUID | None
    calibration_id: UUID | None
    model: str | None
    published_at: datetime
    published_by: str | None
    reason: str | None
    override: OverrideView | None
    is_current: bool
