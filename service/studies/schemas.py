"""What requests and answers about region previews, region suggestions and clock offsets look like."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Received, Sent
from apexcal.documents.region_fields import KeptRegion, Region
from apexcal.documents.states import WorkState
from service.job_status.schemas import JobView

Json = dict[str, Any]


class PreviewRequest(Received):
    """Ask what a region keeps."""

    region: Region


class SuggestionRequest(Received):
    """Ask for a region computed from what moves against the still background; there is nothing to say."""


class OffsetRequest(Received):
    """Ask how far the camera's clock is from the LiDAR's, by a detection's vertices and their marks."""

    detection_id: UUID
    camera: Annotated[str, Field(max_length=200)]
    model: Annotated[str, Field(max_length=50, description="the lens that is fitted along")] = "brown_conrady"


class StudyView(Sent):
    """What all of these have: ``result`` is there when it is done, ``problem`` when it failed."""

    id: UUID
    recording_id: UUID
    state: WorkState
    result: Json | None
    problem: Json | None
    job: JobView | None
    created_at: datetime


class PreviewView(StudyView):
    """A region preview; ``result`` counts frames and points, also per ring."""

    region: KeptRegion


class SuggestionView(StudyView):
    """A suggested region; ``result`` is ``{"region", "facts"}``: a document to detect with, and what led to it."""


class OffsetView(StudyView):
    """A clock offset; ``result`` is ``{"offset_ns", "sigma_ns", "rms_px", "pairs", ...}``, camera minus LiDAR clock.

    ``hint`` says how to use it.
    """

    detection_id: UUID
    camera: str
    marks: int
    hint: str | None
