"""What a vehicle's camera is given: requests to publish, and what was published."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated
from uuid import UUID

from pydantic import AfterValidator, StringConstraints

from apexcal.documents.base import Received, Sent, seen

# A sentence or two that whoever looks later can read.
Reason = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=500), AfterValidator(seen)]


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


class PublicationView(Sent):
    """A result that a vehicle's camera was given: by whom, when, why, and against which objections.

    ``published_by`` is a name, null where the person is no longer known. ``reason`` is null where none was given.
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
