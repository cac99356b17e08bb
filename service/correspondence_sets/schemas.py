"""What requests and answers about correspondence sets look like."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Received, Sent

Json = dict[str, Any]


class BuildRequest(Received):
    """Make pairs of what people marked; ``exclude_flagged`` leaves out vertices whose verdicts are tied."""

    camera: Annotated[str, Field(max_length=200)]
    exclude_flagged: bool = False


class SetView(Sent):
    """A correspondence set without its pairs."""

    id: UUID
    fleet_id: UUID
    vehicle_id: UUID
    rig_id: UUID
    recording_id: UUID | None
    detection_id: UUID | None
    camera: str
    source: Literal["annotations", "import"]
    count: int
    content_hash: str
    notes: list[str]
    flagged: int
    created_at: datetime


class SetWithPairs(SetView):
    """A correspondence set with its pairs: x y z (metres, LiDAR frame), u v (pixels), and what else is known."""

    pairs: list[Json]
