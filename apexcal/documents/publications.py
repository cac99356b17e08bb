"""What a vehicle's camera is given: requests to publish, to withdraw and to move aliases, and what became of them."""

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
    """Why a result is published. ``override`` is needed where the service has objections, and kept with them.

    A result that was published before needs a reason.
    """

    reason: Reason | None = None
    override: Override | None = None


class OverrideView(Sent):
    """Why a result was published all the same, and what spoke against it then."""

    reason: str
    objections: list[str]


class WithdrawalRequest(Received):
    """Why a publication must no longer be used."""

    reason: Reason


class WithdrawalView(Sent):
    """Who withdrew a publication, when and why. ``withdrawn_by`` is null where the person is no longer known."""

    withdrawn_at: datetime
    withdrawn_by: str | None
    reason: str


class PublicationView(Sent):
    """A result that a vehicle's camera was given: by whom, when, why, and against which objections.

    ``published_by`` is a name, null where the person is no longer known. ``reason`` is null where none was given.
    ``withdrawn`` is null unless it was withdrawn; ``gate`` is null if neither rig nor fleet stated one.
    """

    id: UUID
    fleet_id: UUID
    vehicle_id: UUID
    camera: str
    result_id: UUID
    calibration_id: UUID
    model: str
    published_at: datetime
    published_by: str | None
    reason: str | None
    override: OverrideView | None
    is_current: bool
    withdrawn: WithdrawalView | None = None
    gate: Stored[GateVerdict | None] = None


class AliasMoveRequest(Received):
    """Where an alias shall lead, and why. Without a ``result_id`` it is removed.

    Against the service's objections it needs ``override``; then the reason also says why.
    """

    result_id: UUID | None = None
    reason: Reason
    override: bool = False


class AliasMoveView(Sent):
    """One step of an alias: to which result, by whom, when, why and against which objections.

    ``result_id`` is null if the alias was removed or the result was deleted. ``led_to`` is the result's id, also
    after the result was deleted; null if the alias was removed.
    """

    id: UUID
    fleet_id: UUID
    vehicle_id: UUID
    camera: str
    alias: str
    result_id: UUID | None
    led_to: UUID | None = None
    calibration_id: UUID | None
    model: str | None
    moved_at: datetime
    moved_by: str | None
    reason: str
    override: OverrideView | None
    gate: Stored[GateVerdict | None]
    is_current: bool
