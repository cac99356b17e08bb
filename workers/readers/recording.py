"""What every reader yields: sweeps of a LiDAR and frames of a camera, whatever file they came from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

StampConvention = Literal["start", "end", "unknown"]
TimeSource = Literal["per_point", "derived_from_azimuth", "stamp_only"]


class ReadError(Exception):
    """A recording that cannot be read, said so that its owner knows what to do.

    Attributes:
        code: stable machine-readable name, for example ``recording_truncated``.
        message: what is wrong and where.
        hint: what to do about it.
    """

    def __init__(self, code: str, message: str, hint: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.hint = hint


@dataclass(frozen=True, slots=True)
class Sweep:
    """One turn of a LiDAR, N points in the LiDAR's own frame.

    Attributes:
        stamp_ns: the sweep's stamp as its file says, UTC nanoseconds.
        xyz: (N, 3) float32, metres.
        intensity: (N,) float32.
        ring: (N,) uint16, numbered by elevation, 0 the lowest, whatever the sensor's laser ids are.
        offset_ns: (N,) int64, moment of each point relative to ``stamp_ns``.
        time_source: where ``offset_ns`` comes from; all zero for ``stamp_only``.
    """

    stamp_ns: int
    xyz: NDArray[np.float32]
    intensity: NDArray[np.float32]
    ring: NDArray[np.uint16]
    offset_ns: NDArray[np.int64]
    time_source: TimeSource = "stamp_only"


@dataclass(frozen=True, slots=True)
class Frame:
    """One camera frame in an encoded form that browsers show.

    Attributes:
        stamp_ns: UTC nanoseconds.
        media_type: ``image/jpeg``, ``image/png`` or ``image/webp``.
        width, height: pixels, read from the header of ``data``.
        transcoded: whether the bytes differ from those in the file.
    """

    stamp_ns: int
    data: bytes
    media_type: str
    width: int
    height: int
    transcoded: bool = False


@dataclass(frozen=True, slots=True)
class Sensor:
    """One sensor of a recording as its file names it.

    Attributes:
        kind: ``lidar`` or ``camera``.
        name: topic or folder name, unique in the recording.
        frame_id: the coordinate frame that the file states, or an empty string.
        count: number of sweeps or frames, where the file says it before it is read, else None.
        notes: what the file says before it is read, for example ``fields`` of a point cloud.
    """

    kind: Literal["lidar", "camera"]
    name: str
    frame_id: str
    count: int | None
    notes: Mapping[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """What an owner knows of a recording and its file does not say.

    Attributes:
        point_times: ``auto`` uses times of points where the file has them and derives them where it has none;
            ``stamp_only`` leaves them out (static poses whose stamps are made up).
        stamp_convention: whether a sweep's stamp is its start or its end; None: as far as the file tells.
        rate_hz: turns of the LiDAR per second, 0.5 to 1000; None: from the stamps.

    Raises:
        ValueError: a value outside of these.
    """

    point_times: Literal["auto", "stamp_only"] = "auto"
    stamp_convention: StampConvention | None = None
    rate_hz: float | None = None

    def __post_init__(self) -> None:
        if self.point_times not in ("auto", "stamp_only"):
            raise ValueError(f"point_times is 'auto' or 'stamp_only', not {self.point_times!r}")
        if self.stamp_convention not in (None, "start", "end", "unknown"):
            raise ValueError(f"stamp_convention is 'start', 'end' or 'unknown', not {self.stamp_convention!r}")
        if self.rate_hz is not None and not 0.5 <= self.rate_hz <= 1000:
            raise ValueError(f"rate_hz lies between 0.5 and 1000, not at {self.rate_hz}")


@dataclass(frozen=True, slots=True)
class LidarFacts:
    """What holds for a LiDAR through a whole recording.

    Attributes:
        ring_count: rings are numbered 0 to ring_count - 1.
        sweep_ns: duration of one turn, nanoseconds.
        stamp_convention: what a sweep's stamp means.
        time_source: where the times of points come from.
        notes: sentences about what was found and assumed.
    """

    ring_count: int
    sweep_ns: int
    stamp_convention: StampConvention
    time_source: TimeSource
    notes: Sequence[str]


class Recording(Protocol):
    """An opened recording of any format. Readers stream: nothing here holds more than one message.

    ``sweeps``, ``frames`` and ``messages`` raise :class:`ReadError` where the file's content is not usable.

    Attributes:
        format: name of the file format, for example ``rosbag1``.
    """

    format: str

    @property
    def sensors(self) -> Sequence[Sensor]: ...

    @property
    def other_topics(self) -> Sequence[str]:
        """What else the recording holds and no reader takes, for messages to its owner."""
        ...

    @property
    def warnings(self) -> list[str]:
        """Sentences for the owner, growing while the recording is read."""
        ...

    def sweeps(self, sensor: Sensor) -> Iterator[Sweep]: ...

    def frames(self, sensor: Sensor) -> Iterator[Frame]: ...

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All sensors in one pass over the file, in the order in which they were recorded."""
        ...

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """What was learned of a LiDAR from a few of its sweeps.

        Raises:
            ReadError: its clouds are not usable, for example ``cloud_without_rings``.
        """
        ...

    def close(self) -> None: ...
