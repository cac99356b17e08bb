"""The contents of a recording and what it lacks, told before anything is uploaded."""

from __future__ import annotations

from typing import Literal

from apexcal.documents.base import Document
from apexcal.documents.omissions import Omission
from apexcal.documents.readings import ImageKind
from apexcal.documents.recordings import StatedLens
from apexcal.documents.rig_proposals import RigProposal


class RecordingFault(Document):
    """Something that a recording lacks. ``look``: a camera can be calibrated all the same; ``stop``: it cannot.

    ``sensor``: its name; empty if it is about the whole recording.
    """

    code: str
    sensor: str
    verdict: Literal["look", "stop"]
    sentence: str
    remedy: str


class InspectedSensor(Document):
    """A LiDAR or camera as its file names it: how often it was recorded, and when. A camera's images and lens.

    ``first_ns``, ``last_ns``: times of recording, UTC nanoseconds. ``rate_hz`` and ``longest_pause_s`` are null where
    the times were made up from the numbers of files. ``delay_s``: how long after their stamps messages
    were recorded (median); null where the file has no two clocks. ``offset_ns``: of a camera, its clock minus the
    LiDAR's by the times of recording, which spread by ``spread_ns``; null where they are less than a second apart.
    ``lens``: as a CameraInfo states it.
    """

    kind: Literal["lidar", "camera"]
    name: str
    topic: str
    frame_id: str
    count: int
    first_ns: int
    last_ns: int
    rate_hz: float | None
    longest_pause_s: float | None
    delay_s: float | None
    offset_ns: int | None = None
    spread_ns: int | None = None
    image_size: tuple[int, int] | None = None
    image_kind: ImageKind | None = None
    lens: StatedLens | None = None


class Inspection(Document):
    """A recording's format, length, sensors (the LiDAR first) and faults, and the cameras that it can calibrate.

    ``is_connected``: whether its ``/tf_static`` leads from the LiDAR to every camera; null if it states no frames.
    ``omissions``: messages that ingestion leaves out, of those that were looked at. ``notes``: what was learned and
    assumed of its files and of the LiDAR, as ingestion says it. ``proposal``: a rig for it; null without cameras.
    """

    format: str
    seconds: float
    sensors: list[InspectedSensor]
    other_topics: list[str]
    is_connected: bool | None
    faults: list[RecordingFault]
    omissions: list[Omission] = []
    notes: list[str] = []
    calibratable: list[str]
    proposal: RigProposal | None = None
