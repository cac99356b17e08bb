"""An ingestion's account of the files that it wrote; plain data that goes to JSON and back."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from apexcal.documents.base import Document
from apexcal.documents.omissions import Omission
from apexcal.documents.recordings import FixedFrame, RecordingFacts, SensorFacts, StampFacts

_BareName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]


class SensorStamps(StampFacts):
    """Number of frames or sweeps; smallest and largest stamp, UTC nanoseconds."""

    count: int
    first_ns: int
    last_ns: int


class SensorManifest(SensorFacts, SensorStamps):
    """One sensor of a normalised recording.

    Attributes:
        name: ``lidar``, or the camera's name in the rig.
        topic: topic or folder in the original.
        frame_id: coordinate frame that the original states, or empty.
        file: name of its file.
    """

    model_config = ConfigDict(extra="forbid")

    kind: Literal["lidar", "camera"]
    name: str
    topic: str
    frame_id: str
    file: _BareName


class RecordingManifest(Document):
    """A normalised recording: the format it came in, its sensors (the LiDAR first), and warnings for its owner.

    ``omissions`` are messages that were left out. ``static_transforms`` are the poses of frames that it states to be
    fixed. It may come from a process that read a stranger's file.
    """

    model_config = ConfigDict(extra="forbid")

    format: str
    sensors: list[SensorManifest]
    warnings: list[str]
    static_transforms: list[FixedFrame]
    omissions: list[Omission]

    def facts(self) -> dict[str, Any]:
        """Return the facts about the recording as a whole; ``together_s`` is how long all its sensors ran."""
        first = min(sensor.first_ns for sensor in self.sensors)
        last = max(sensor.last_ns for sensor in self.sensors)
        together = min(s.last_ns for s in self.sensors) - max(s.first_ns for s in self.sensors)
        is_timed = any(sensor.rate_hz for sensor in self.sensors)  # else their times were made up
        facts = RecordingFacts(
            format=self.format,
            first_ns=first,
            last_ns=last,
            seconds=(last - first) / 1e9 if is_timed else 0.0,
            together_s=max(0, together) / 1e9 if is_timed else 0.0,
            static_transforms=self.static_transforms,
            omissions=self.omissions,
        )
        return facts.model_dump(mode="json", exclude=None if self.static_transforms else {"static_transforms"})
