"""Bodies of the routes about recordings."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Document, Name, Received, Sent, Stored
from apexcal.documents.jobs import JobView, ProblemView
from apexcal.documents.omissions import Omission
from apexcal.documents.readings import FrameOrigin, ImageKind, Reading, StampConvention
from apexcal.documents.states import RecordingState

MAX_PARTS = 100_000

MarksPerVertex = Annotated[int, Field(ge=1, le=100)]


class NewRecording(Received):
    """A recording to upload: one file of a known format, or a folder packed as tar.

    Without ``rig_id`` the vehicle gets a rig that reading the recording describes.
    ``size`` is that of the file in bytes. With it the fleet's quota is checked once for all parts, without it
    for each part.
    """

    rig_id: UUID | None = None
    name: Name
    file_name: Name
    size: Annotated[int, Field(ge=1, lt=2**63)] | None = None
    marks_per_vertex: MarksPerVertex = 1
    retain_days: Annotated[int, Field(ge=1, le=36_500)] | None = None
    reading: Reading = Reading()


class RecordingEdit(Received):
    """Changes of a recording; the reading only before it is ready, because the ingestion uses it.

    ``reading`` replaces the whole of it. The rig of a ready one is replaced by another that has the same sensors.
    """

    rig_id: UUID | None = None
    reading: Reading | None = None
    name: Name | None = None
    marks_per_vertex: MarksPerVertex | None = None


Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Upload(Sent):
    """The way to send parts: with ``api`` each is put here, with ``presigned`` at an address that is asked for.

    An upload that got no part until ``expires_at`` is removed.
    """

    part_bytes: int
    max_part_bytes: int
    parts: Literal["api", "presigned"]
    expires_at: datetime | None


class PartView(Sent):
    """An acknowledged part."""

    number: int
    size: int
    sha256: str


class Parts(Sent):
    """All acknowledged parts."""

    items: list[PartView]
    upload: Upload


class NewPart(Received):
    """A part that will be put straight into the store."""

    size: Annotated[int, Field(ge=1)]
    sha256: Sha256


class PartAddress(Sent):
    """The address for PUT of a part until ``expires_at``; or ``part``, if these bytes are acknowledged already.

    ``reservation`` is sent back once they are put.
    """

    part: PartView | None = None
    url: str | None = None
    expires_at: datetime | None = None
    reservation: str | None = None


class PutPart(Received):
    """The bytes of this reservation have been put."""

    reservation: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]


class BlobAddress(Sent):
    """The address of bytes in the store until ``expires_at``: the range of ``length`` from ``offset``.

    ``url`` is null where they go through the API.
    """

    url: str | None = None
    expires_at: datetime | None = None
    offset: int = 0
    length: int
    media_type: str


class OriginalPart(PartView):
    """A part of the original; ``url`` is null where its bytes go through the API."""

    url: str | None


class Original(Sent):
    """The uploaded file: its parts in order, one after the other, are its bytes."""

    file_name: str
    size: int
    expires_at: datetime | None
    parts: list[OriginalPart]


class Completion(Received):
    """The whole that the parts make; ``sha256`` (hexadecimal) is checked before ingestion."""

    parts: Annotated[int, Field(ge=1, le=MAX_PARTS)]
    size: Annotated[int, Field(ge=1, lt=2**63)]
    sha256: Sha256 | None = None


class Gap(Document):
    """A pause after the stamp ``after_ns``; its duration is negative where the clock was set back."""

    after_ns: int
    duration_ns: int


class StatedLens(Document):
    """The intrinsics that a file states: ``K`` by rows, ``D`` in OpenCV's order. ``model`` is null where none is.

    ``source``: the file that stated them later; null if they are the recording's own. ``R`` (9) turns from the
    camera's frame to that of its rectified images, ``P`` (12) projects into them; by rows.
    """

    model: str | None
    K: list[float]
    D: list[float]
    R: list[float] | None = None
    P: list[float] | None = None
    distortion_model: str | None = None
    source: str | None = None
    width: int
    height: int


class ImageSize(Document):
    """The number of frames of one size."""

    width: int
    height: int
    count: int


class StampFacts(Document):
    """The facts that a sensor's stamps tell.

    Attributes:
        rate_hz: from the median step between stamps; None for fewer than two.
        gaps: pauses of more than 1.75 steps, the first thousand; ``gap_count`` counts all.
        missing: messages that these gaps would have held.
        jumps: steps of the clock, in recorded order: those that were taken out of the stamps, pauses of over an hour,
            and steps back (negative) of a second or for several messages.
        backwards, duplicates: messages with an earlier stamp than the previous message, and with the same stamp.
    """

    rate_hz: float | None = None
    gaps: list[Gap] = []
    gap_count: int = 0
    missing: int = 0
    jumps: list[Gap] = []
    backwards: int = 0
    duplicates: int = 0


class SensorFacts(StampFacts):
    """The reading of a sensor, and what stands out in it.

    ``empty`` counts sweeps without a point, which were left out.
    ``offset_ns``: of a camera, its clock minus the LiDAR's by the times of recording, which spread by ``spread_ns``;
    null where the clocks are less than a second apart, or nothing tells.
    """

    stamp_convention: StampConvention | None = None
    time_source: str | None = None
    ring_count: int | None = None
    points: int | None = None
    partial: list[str] = []
    empty: int = 0
    transcoded: bool | None = None
    width: int | None = None
    height: int | None = None
    sizes: list[ImageSize] = []
    overlap_s: float | None = None
    overlap_share: float | None = None
    offset_ns: int | None = None
    spread_ns: int | None = None
    camera_info: StatedLens | None = None
    image_kind: ImageKind | None = None
    notes: list[str] = []


class FixedFrame(Document):
    """``T_parent_child``: the pose of a frame in its parent, as the recording's topic ``origin`` says it.

    Metres; a unit quaternion.
    """

    parent: str
    child: str
    translation_m: Annotated[list[float], Field(min_length=3, max_length=3)]
    quaternion_xyzw: Annotated[list[float], Field(min_length=4, max_length=4)]
    origin: FrameOrigin = "tf_static"


class RecordingFacts(Document):
    """The facts about a recording as a whole.

    ``together_s`` is how long all its sensors ran, ``omissions`` what was left out, because it cannot be used.
    """

    format: str
    first_ns: int
    last_ns: int
    seconds: float
    together_s: float
    static_transforms: list[FixedFrame] = []
    omissions: list[Omission] = []


class SensorView(Sent):
    """A normalised sensor of a recording."""

    id: UUID
    kind: str
    name: str
    topic: str
    frame_id: str
    count: int
    first_ns: int
    last_ns: int
    facts: Stored[SensorFacts]


class RecordingSummary(Sent):
    """A recording as lists show it."""

    id: UUID
    fleet_id: UUID
    vehicle_id: UUID
    rig_id: UUID
    name: str
    file_name: str
    state: RecordingState
    size: int
    marks_per_vertex: int
    reading: Stored[Reading]
    facts: Stored[RecordingFacts | None]
    warnings: Stored[list[str]]
    problem: Stored[ProblemView | None]
    retain_until: datetime | None
    created_at: datetime
    version: int
    job: JobView | None = None


class RecordingView(RecordingSummary):
    """A recording with its sensors."""

    sensors: list[SensorView]


class CreatedRecording(RecordingView):
    """A recording that waits for its parts."""

    upload: Upload


class AcceptedRecording(Sent):
    """A recording on its way, and the job to follow."""

    recording: RecordingView
    job: JobView


class FrameView(Sent):
    """A camera frame; ``stamp_ns`` is UTC in nanoseconds."""

    index: int
    stamp_ns: int
    media_type: str
    width: int
    height: int
