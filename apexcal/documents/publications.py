"""What a vehicle's camera is given: requests to publish and to withdraw, and what became of them."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated
from uuid import UUID

from pydantic import AfterValidator, StringConstraints

from apexcal.documents.base import Received, Sent, Stored, seen
from apexcal.documents.gates import GateVerdict

# A sentence or two that whoever looks later can read.
Reason = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=500), AfterValidator(seen)]


CURRENT = "current"
# It stands in addresses.
AliasName = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_.-]{0,63}$")]


class Override(Received):
    """Publish although something speaks against it, and why."""

    reason: Reason


class PublicationRequest(Received):
    """Under which alias a result is published, and why. ``override`` is needed where the service has objections.

    It is kept with them. A result that the alias led to before needs a reason.
    """

    alias: AliasName = CURRENT
    reason: Reason | None = None
    override: Override | None = None


class OverrideView(Sent):
    """Why a result was published all the same, and what spoke against it then."""

    reason: str
    objections: list[str]


class WithdrawalRequest(Received):
    """Why a publication must no longer be used."""

    reason: Reason


class PublicationView(Sent):
    """A move of an alias of a vehicle's camera: to which result, by whom, when, why, and against which objections.

    ``number`` counts the alias's moves from 1. ``result_id`` is null if the alias leads nowhere since: it was
    withdrawn, or its result was deleted. ``led_to`` is the result's id, also after the result was deleted; null of a
    withdrawal. ``published_by`` is a name, null where the person is no longer known. ``reason`` is null where none
    was given; ``gate`` if neither rig nor fleet stated one. ``is_current``: the alias leads to this result now.
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
    gate: Stored[GateVerdict | None]
    is_current: bool
