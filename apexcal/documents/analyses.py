"""The members of every analysis, and region previews, region suggestions, clock offsets and reports."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Document, Received, Sent, Stored
from apexcal.documents.checks import CheckVerdict
from apexcal.documents.jobs import JobView, ProblemView
from apexcal.documents.regions import KeptRegion, Region
from apexcal.documents.states import WorkState


class RecordingQuestion(Received):
    """A question to a recording that is ready."""

    recording_id: UUID


class PreviewRequest(RecordingQuestion):
    """Ask what a region keeps."""

    kind: Literal["preview"]
    region: Region


class SuggestionRequest(RecordingQuestion):
    """Ask for a region computed from what moves against the still background."""

    kind: Literal["suggestion"]


class OffsetRequest(Received):
    """Ask how far the camera's clock is from the LiDAR's, by a detection's vertices and their marks."""

    kind: Literal["clock_offset"]
    detection_id: UUID
    camera: Annotated[str, Field(max_length=200)]
    model: Annotated[str, Field(max_length=50, description="the camera model that is fitted with the offset")] = (
        "brown_conrady"
    )


class AnalysisView(Sent):
    """The members of all kinds: ``result`` is there when it is done, ``problem`` when it failed.

    The ids say what it is of. It is deleted with each of these.
    """

    id: UUID
    fleet_id: UUID
    vehicle_id: UUID
    recording_id: UUID | None
    detection_id: UUID | None
    set_id: UUID | None
    result_id: UUID | None
    state: WorkState
    problem: Stored[ProblemView | None]
    job: JobView | None
    created_at: datetime


class StoredFile(Document):
    """The file that an analysis made: its name, size in bytes and SHA-256."""

    file_name: str
    size: int
    sha256: str


class RingCount(Document):
    """Counts of a ring's points, and of those that a region keeps."""

    ring: int
    points: int
    points_kept: int


class RegionPreview(Document):
    """Counts over the sweeps; a sweep is kept where at least one of its points lies inside.

    ``points_per_frame_median`` is over all sweeps, also empty ones. ``per_ring`` has the rings with any point, the
    lowest first.
    """

    frames: int
    frames_kept: int
    points: int
    points_kept: int
    points_per_frame_median: float
    per_ring: list[RingCount]


class PreviewView(AnalysisView):
    """The points and frames that a region keeps."""

    kind: Literal["preview"]
    region: KeptRegion
    result: Stored[RegionPreview | None]


class SuggestionFacts(Document):
    """The facts that a suggestion rests on, for the person who decides.

    ``sweeps_read``, and ``sweeps_moving`` of them in which something of a person's size moved; ``points_per_sweep``,
    the median number of points that the region keeps in these; ``area_m2`` of the polygon; ``ground_z`` in its middle
    and ``z_low``, ``z_high`` of the region, metres; ``posts``, how many things that stand still were cut out.
    ``poses``: how many still poses the recording has; 0 for a walk.
    """

    sweeps_read: int
    sweeps_moving: int
    points_per_sweep: float
    area_m2: float
    ground_z: float
    z_low: float
    z_high: float
    posts: int
    notes: list[str]
    poses: int = 0


class SuggestedRegion(Document):
    """A region to detect with, and what led to it."""

    region: KeptRegion
    facts: SuggestionFacts


class SuggestionView(AnalysisView):
    """A suggested region."""

    kind: Literal["suggestion"]
    result: Stored[SuggestedRegion | None]


class ClockOffset(Document):
    """The camera's clock minus the LiDAR's, as ``pairing.offset_ns`` wants it, and its standard deviation.

    ``rms_px`` is over the ``pairs`` marks that were used. ``blunders`` were left out because they lie far from all
    others, ``unseen`` because no vertex is near their moment. ``speed_px_s``: how fast the apex moved in the image.
    """

    offset_ns: int
    sigma_ns: int
    rms_px: float
    pairs: int
    blunders: int
    unseen: int
    speed_px_s: float
    message: str


class OffsetView(AnalysisView):
    """A clock offset; ``hint`` says how to use it."""

    kind: Literal["clock_offset"]
    result: Stored[ClockOffset | None]
    camera: str
    marks: int
    hint: str | None


class ReportRequest(Received):
    """Ask for the report of a result, which must be a fit to all pairs."""

    kind: Literal["report"]
    result_id: UUID


class ReportFile(StoredFile):
    """The report. ``verdict`` is the gravest of the checks that it shows, for the mount with its lens."""

    verdict: CheckVerdict


class ReportView(AnalysisView):
    """A result's report; when it is done, its file can be read."""

    kind: Literal["report"]
    result: Stored[ReportFile | None]
