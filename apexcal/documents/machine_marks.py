"""Requests and answers about marks by the machine."""

from __future__ import annotations

from typing import Annotated, Final, Literal
from uuid import UUID

from pydantic import Field

from apexcal.documents.analyses import AnalysisView
from apexcal.documents.base import Document, Received, Sent, Stored
from apexcal.documents.corners import CornerName

MOST_VERTICES = 300
"""Of a detection, spread evenly: with more, marks are no longer what limits a calibration."""
TILE_COLUMNS: Final = ("tile_u", "tile_v", "tile_width", "tile_height", "tile_offset", "tile_length")
"""Where the piece of the frame around a mark lies in the frame (px), and its PNG in the analysis's file (bytes)."""
MarkReason = Literal[
    "no_mount", "outside", "few_pixels", "no_edge", "moved_far", "off_mount", "two_places", "no_corner", "no_frame"
]


class MarksRequest(Received):
    """Ask for the machine's marks of a detection's vertices in one camera."""

    kind: Literal["machine_marks"]
    detection_id: UUID
    camera: Annotated[str, Field(max_length=200)]
    model: Annotated[str, Field(max_length=50, description="of the lens, where the recording states none")] = (
        "brown_conrady"
    )


class MarksFacts(Document):
    """Counts of corners and of those ``marked``, ``reasons`` of the others, and the median deviation.

    ``clock_offset_ms``: the camera's clock minus the LiDAR's, where a walk's marks tell another than the pairing's.
    ``warning``: how the marks contradict the rig's mount, if no calibration about that finds theirs.
    """

    corners: int
    marked: int
    reasons: dict[str, int]
    refusal: str | None
    sigma_px: float | None
    clock_offset_ms: float | None = None
    warning: str | None = None


class MarksView(AnalysisView):
    """The machine's marks, in numbers; `GET /v1/analyses/{id}/marks` has them."""

    kind: Literal["machine_marks"]
    result: Stored[MarksFacts | None]
    camera: str


class MarkPlace(Sent):
    """A place where a corner may be, pixels, and its probability (``weight``)."""

    u: float
    v: float
    weight: float


class MachineMark(Sent):
    """A vertex and its mark with standard deviations, pixels, or the ``reason`` why it has none.

    ``edge_px``: length of the shorter of the corner's two edges in the frame. ``places``: the two between which the
    machine cannot decide (reason ``two_places``).
    """

    vertex_id: UUID
    corner: CornerName
    u: float | None = None
    v: float | None = None
    sigma_u: float | None = None
    sigma_v: float | None = None
    edge_px: float | None = None
    places: list[MarkPlace] = []
    reason: MarkReason | None = None


class MarksList(Sent):
    """The machine's marks of a detection's vertices in one camera, with the reasons for those without."""

    marks: list[MachineMark]
