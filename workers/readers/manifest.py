"""What an ingestion tells of the files it wrote; plain data that goes to JSON and back."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal, Self

from workers.readers.recording import StampConvention, TimeSource

MAX_GAPS_LISTED: Final = 1000


@dataclass(frozen=True, slots=True)
class Gap:
    """A pause in a sensor's stamps.

    Attributes:
        after_ns: stamp of the last message before it.
        duration_ns: to the next stamp.
    """

    after_ns: int
    duration_ns: int


@dataclass(frozen=True, slots=True)
class SensorManifest:
    """One sensor of a normalised recording.

    Attributes:
        kind: ``lidar`` or ``camera``.
        name: ``lidar``, or the camera's name in the rig.
        topic: topic or folder in the original.
        frame_id: coordinate frame that the original states, or empty.
        file: name of the MCAP file.
        frames: name of the sidecar with the table of frames or sweeps (:func:`read_table`).
        count: number of frames or sweeps.
        first_ns, last_ns: smallest and largest stamp, UTC nanoseconds.
        rate_hz: from the median step between stamps; None for fewer than two.
        gaps: pauses of more than 1.75 steps, the first :data:`MAX_GAPS_LISTED`; ``gap_count`` counts all.
        stamp_convention, time_source, ring_count: of a LiDAR; None for a camera.
        transcoded: of a camera: whether frames were encoded anew, and from what is in ``notes``.
        width, height: of a camera's first frame, pixels.
        notes: sentences about how the sensor was read.
    """

    kind: Literal["lidar", "camera"]
    name: str
    topic: str
    frame_id: str
    file: str
    frames: str
    count: int
    first_ns: int
    last_ns: int
    rate_hz: float | None
    gaps: Sequence[Gap]
    gap_count: int
    stamp_convention: StampConvention | None = None
    time_source: TimeSource | None = None
    ring_count: int | None = None
    transcoded: bool | None = None
    width: int | None = None
    height: int | None = None
    notes: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Manifest:
    """A normalised recording: the format it came in, its sensors (the LiDAR first), and warnings for its owner."""

    format: str
    sensors: Sequence[SensorManifest]
    warnings: Sequence[str]

    def to_json(self) -> dict[str, Any]:
        """Plain data for ``json.dumps``."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Self:
        """Back from :meth:`to_json`.

        Raises:
            KeyError, TypeError, ValueError: not the data of a manifest.
        """
        for sensor in data["sensors"]:
            for name in (sensor["file"], sensor["frames"]):
                if Path(name).name != name:  # the data may come from a process that read a stranger's file
                    raise ValueError(f"{name!r} is no bare file name")
        sensors = [replace(SensorManifest(**s), gaps=[Gap(**gap) for gap in s["gaps"]]) for s in data["sensors"]]
        return cls(str(data["format"]), sensors, [str(w) for w in data["warnings"]])


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
    with path.open("w") as file:
        json.dump(asdict(table), file, separators=(",", ":"))


def read_table(path: Path) -> FrameTable | SweepTable:
    """Read a table written by :func:`write_table`.

    Raises:
        TypeError: not such a table.
    """
    with path.open() as file:
        columns = json.load(file)
    return FrameTable(**columns) if "offset" in columns else SweepTable(**columns)
