"""Requests and answers about correspondence sets."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Document, Received, Sent
from apexcal.documents.corners import CornerName


class BuildRequest(Received):
    """Make pairs of what people marked; ``exclude_flagged`` leaves out vertices whose verdicts are tied.

    The machine's marks that somebody confirmed count as those of one more person; with ``machine_marks`` those that
    nobody looked at count too.
    """

    camera: Annotated[str, Field(max_length=200)]
    exclude_flagged: bool = False
    machine_marks: bool = False


class SelectionRequest(Received):
    """Make a set without these pairs, by their numbers from 0."""

    leave_out: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1, max_length=10_000)]


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


class PairView(Document):
    """A pair: a vertex (metres, LiDAR frame), its mark (pixels), and what else is known of them.

    Without ``corner`` it is of the board's tip. ``machine``: no person marked it; ``confirmed`` people accepted the
    machine's mark after they saw it. ``machine_off_px``: the machine's mark minus people's blind ones.
    ``velocity_m_s``: how the corner moved then.
    """

    x: float
    y: float
    z: float
    u: float
    v: float
    stamp_ns: int | None = None
    gap_ns: int | None = None
    sweep_index: int | None = None
    frame_index: int | None = None
    group: int | float | str | None = None
    marks: int | None = None
    spread_px: float | None = None
    flagged: bool | None = None
    reviewed: int | None = None
    sigma_azimuth_rad: float | None = None
    sigma_elevation_rad: float | None = None
    sigma_range_m: float | None = None
    sigma_px: float | None = None
    marked_by: list[int] | None = None
    machine: bool | None = None
    confirmed: int | None = None
    machine_off_px: list[float] | None = None
    sigma_clock_ms: float | None = None
    velocity_m_s: list[float] | None = None
    corner: CornerName | None = None


class SetWithPairs(SetView):
    """A correspondence set with its pairs."""

    pairs: list[PairView]
