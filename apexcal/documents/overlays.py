"""A camera frame with the LiDAR's points, drawn through a result's lens."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Document, Received, Stored
from apexcal.documents.studies import StudyView


class OverlayRequest(Received):
    """Ask for a frame with the points of the sweep nearest to it.

    ``frame``: its number, from 0. ``recording_id``: by default the recording that the result's pairs are of; any
    recording of the result's rig may be named.
    """

    frame: Annotated[int, Field(ge=0, lt=2**31)]
    recording_id: UUID | None = None


class DrawnOverlay(Document):
    """The file: its name, size and SHA-256, width and height in pixels; and what is drawn.

    ``after_ns``: when the sweep's middle was measured, relative to the frame. ``points`` are drawn, ``hidden`` more
    are hidden by nearer ones. ``moved`` points of board and holder are drawn where they were at the frame's time, at
    most ``farthest_moved_m`` from where they were measured. ``depth_m``: the distances from the camera of the
    palette's ends; null if no point is drawn.
    """

    file_name: str
    size: int
    sha256: str
    width: int
    height: int
    sweep_index: int
    after_ns: int
    points: int
    hidden: int
    moved: int
    farthest_moved_m: float
    depth_m: tuple[float, float] | None


class OverlayView(StudyView):
    """An overlay; when it is done, its image can be read."""

    result: Stored[DrawnOverlay | None]
    result_id: UUID
    camera: str
    frame: int
