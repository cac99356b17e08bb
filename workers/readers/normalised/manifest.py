"""What an ingestion tells of the files it wrote; plain data that goes to JSON and back."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from io import TextIOWrapper
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import TypeAdapter

from apexcal.documents.readings import ImageKind
from workers.readers.output import create
from workers.readers.recording import StampConvention, StaticTransform, TimeSource

MAX_GAPS_LISTED: Final = 1000


@dataclass(frozen=True, slots=True)
class StampGap:
    """A pause in a sensor's stamps.

    Attributes:
        after_ns: stamp of the last message before it.
        duration_ns: to the next stamp; negative where the clock was set back.
    """

    after_ns: int
    duration_ns: int


@dataclass(frozen=True, slots=True)
class FrameSize:
    """Frames of one size: ``count`` of ``width`` x ``height`` pixels."""

    width: int
    height: int
    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StampFacts:
    """What a sensor's stamps tell.

    Attributes:
        count: number of frames or sweeps.
        first_ns, last_ns: smallest and largest stamp, UTC nanoseconds.
        rate_hz: from the median step between stamps; None for fewer than two.
        gaps: pauses of more than 1.75 steps, the first :data:`MAX_GAPS_LISTED`; ``gap_count`` counts all.
        missing: messages that these gaps would have held.
        jumps: steps of the clock: pauses of over an hour, and steps back (negative) of a second or for several
            messages, in recorded order.
        backwards, duplicates: messages with an earlier stamp than the one before, and with the same.
    """

    count: int
    first_ns: int
    last_ns: int
    rate_hz: float | None
    gaps: Sequence[StampGap]
    gap_count: int
    missing: int = 0
    jumps: Sequence[StampGap] = field(default_factory=list[StampGap])
    backwards: int = 0
    duplicates: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorManifest(StampFacts):
    """One sensor of a normalised recording.

    Attributes:
        kind: ``lidar`` or ``camera``.
        name: ``lidar``, or the camera's name in the rig.
        topic: topic or folder in the original.
        frame_id: coordinate frame that the original states, or empty.
        file: name of the MCAP file.
        frames: name of the sidecar with the table of frames or sweeps (:func:`read_table`).
        stamp_convention, time_source, ring_count: of a LiDAR; None for a camera.
        points: of a LiDAR: points of a usual sweep (the median).
        partial: of a LiDAR: which of its ``first`` and ``last`` sweep hold clearly fewer.
        empty: of a LiDAR: sweeps without a point.
        transcoded: of a camera: whether frames were encoded anew, and from what is in ``notes``.
        width, height: of a camera's first frame, pixels.
        sizes: of a camera: how many frames have which size, the most frequent first.
        overlap_s, overlap_share: of a camera: how long it ran together with the LiDAR, seconds, and as a share of the
            LiDAR's time.
        camera_info, image_kind: of a camera: the intrinsics that its file states, and what its images are; see
            :class:`Sensor`.
        notes: sentences about how the sensor was read.
    """

    kind: Literal["lidar", "camera"]
    name: str
    topic: str
    frame_id: str
    file: str
    frames: str
    stamp_convention: StampConvention | None = None
    time_source: TimeSource | None = None
    ring_count: int | None = None
    points: int | None = None
    partial: Sequence[str] = field(default_factory=list[str])
    empty: int = 0
    transcoded: bool | None = None
    width: int | None = None
    height: int | None = None
    sizes: Sequence[FrameSize] = field(default_factory=list[FrameSize])
    overlap_s: float | None = None
    overlap_share: float | None = None
    camera_info: Mapping[str, Any] | None = None
    image_kind: ImageKind | None = None
    notes: Sequence[str] = field(default_factory=list[str])


@dataclass(frozen=True, slots=True)
class RecordingManifest:
    """A normalised recording: the format it came in, its sensors (the LiDAR first), and warnings for its owner.

    ``static_transforms`` are the poses of frames that it states to be fixed.
    """

    format: str
    sensors: Sequence[SensorManifest]
    warnings: Sequence[str]
    static_transforms: Sequence[StaticTransform] = ()

    def facts(self) -> dict[str, Any]:
        """What is true of the recording as a whole; ``together_s`` is how long all its sensors ran."""
        first = min(sensor.first_ns for sensor in self.sensors)
        last = max(sensor.last_ns for sensor in self.sensors)
        together = min(s.last_ns for s in self.sensors) - max(s.first_ns for s in self.sensors)
        fixed = (
            {"static_transforms": [asdict(pose) for pose in self.static_transforms]} if self.static_transforms else {}
        )
        return fixed | {
            "format": self.format,
            "first_ns": first,
            "last_ns": last,
            "seconds": (last - first) / 1e9,
            "together_s": max(0, together) / 1e9,
        }

    def to_json(self) -> dict[str, Any]:
        """Plain data for ``json.dumps``."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """Back from :meth:`to_json`. Raises ValueError for what is not the data of a manifest."""
        manifest = TypeAdapter(cls).validate_python(data)
        for name in (name for sensor in manifest.sensors for name in (sensor.file, sensor.frames)):
            if Path(name).name != name:  # the data may come from a process that read a stranger's file
                raise ValueError(f"{name!r} is no bare file name")
        return manifest


@dataclass(frozen=True, slots=True)
class FrameTable:
    """Where each frame of a camera stands in its file, ordered by stamp; index i is the frame's number.

    Attributes:
        stamp_ns: UTC nanoseconds.
        offset, length: byte range of the encoded image in the MCAP file.
        media_type, width, height: of that image.
    """

    stamp_ns: Sequence[int]
    offset: Sequence[int]
    length: Sequence[int]
    media_type: Sequence[str]
    width: Sequence[int]
    height: Sequence[int]

    def __len__(self) -> int:
        return len(self.stamp_ns)


@dataclass(frozen=True, slots=True)
class SweepTable:
    """The sweeps of a LiDAR file, ordered by stamp; index i is :meth:`LidarFile.sweep`'s.

    Attributes:
        stamp_ns: UTC nanoseconds.
        points: number of points.
    """

    stamp_ns: Sequence[int]
    points: Sequence[int]

    def __len__(self) -> int:
        return len(self.stamp_ns)


def write_table(path: Path, table: FrameTable | SweepTable) -> None:
    """Write a table as JSON, a column per key."""
    with TextIOWrapper(create(path), "ascii") as file:
        json.dump(asdict(table), file, separators=(",", ":"))


def read_table(path: Path) -> FrameTable | SweepTable:
    """Read a table written by :func:`write_table`.

    Raises:
        TypeError: not such a table.
    """
    with path.open() as file:
        columns = json.load(file)
    return FrameTable(**columns) if "offset" in columns else SweepTable(**columns)
