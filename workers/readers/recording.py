"""The interface of every reader: sweeps of a LiDAR and frames of a camera, whatever file they came from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ImageKind, StampConvention
from apexcal.documents.recordings import FixedFrame

if TYPE_CHECKING:
    from workers.readers.omissions import Omissions

TimeSource = Literal["per_point", "derived_from_azimuth", "stamp_only"]

_LONGEST_WORD: Final = 300
_LONGEST_TEXT: Final = 20_000


def legible(text: str) -> str:
    """A sentence without what names from a file may bring in: control characters, and words without end."""
    plain = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text[: _LONGEST_TEXT + 1])
    plain = re.sub(rf"(\S{{{_LONGEST_WORD}}})\S+", r"\1...", plain)
    return plain if len(plain) <= _LONGEST_TEXT else plain[:_LONGEST_TEXT] + "..."


class ReadError(Exception):
    """A recording that cannot be read, said so that its owner knows what to do.

    Attributes:
        code: stable machine-readable name, for example ``recording_truncated``.
        message: what is wrong and where, one line that can be printed, whatever names it was made from.
        hint: what to do about it.
        fields: plain data for a program that answers, for example ``candidates``, the topics to choose from.
    """

    def __init__(self, code: str, message: str, hint: str, fields: Mapping[str, Any] | None = None) -> None:
        self.message = legible(message)
        super().__init__(self.message)
        self.code = code
        self.hint = hint
        self.fields = dict(fields or {})


class MessageError(ReadError):
    """One message that cannot be used. It is left out; the others may serve."""


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
        log_ns: time of recording, None where the file has no other time than the stamp.
    """

    stamp_ns: int
    xyz: NDArray[np.float32]
    intensity: NDArray[np.float32]
    ring: NDArray[np.uint16]
    offset_ns: NDArray[np.int64]
    time_source: TimeSource = "stamp_only"
    log_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Frame:
    """One camera frame in an encoded form that browsers show.

    Attributes:
        stamp_ns: UTC nanoseconds.
        media_type: ``image/jpeg``, ``image/png`` or ``image/webp``.
        width, height: pixels, read from the header of ``data``.
        transcoding: what was done to the bytes in the file, a sentence for the owner; the same for all frames that it
            was done to. Empty: nothing.
        log_ns: time of recording, None where the file has no other time than the stamp.
    """

    stamp_ns: int
    data: bytes
    media_type: str
    width: int
    height: int
    transcoding: str = ""
    log_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Sensor:
    """One sensor of a recording as its file names it.

    Attributes:
        kind: ``lidar`` or ``camera``.
        name: topic or folder name, unique in the recording.
        frame_id: the coordinate frame that the file states, or an empty string.
        count: number of sweeps or frames, where the file says it before it is read, else None.
        notes: what the file says before it is read: ``fields`` of a point cloud (names, separated by spaces),
            ``type`` of a topic, ``width`` and ``height`` of a camera's first frame, ``rate_hz``.
        camera_info: of a camera: the intrinsics that the file states, a starting guess: ``model`` (a name of ours),
            ``K`` (9 numbers, rows), ``D``, ``distortion_model`` as in the file, ``R`` (9) and ``P`` (12) of its
            rectified images or None, ``width``, ``height``.
        image_kind: of a camera: whether its images are raw or rectified, as far as the file tells.
    """

    kind: Literal["lidar", "camera"]
    name: str
    frame_id: str
    count: int | None
    notes: Mapping[str, str] = field(default_factory=dict[str, str])
    camera_info: Mapping[str, Any] | None = None
    image_kind: ImageKind | None = None

    @property
    def has_times(self) -> bool:
        """Whether its times were recorded; else they were made up from the numbers of its files."""
        return self.notes.get("times_from") != "index"

    @property
    def image_size(self) -> tuple[int, int] | None:
        """Width and height of a camera's first image, pixels; None where the file does not tell."""
        width, height = self.notes.get("width", ""), self.notes.get("height", "")
        return (int(width), int(height)) if width.isdigit() and height.isdigit() else None


@dataclass(frozen=True, slots=True)
class LidarFacts:
    """Facts that hold for a LiDAR through a whole recording.

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


class Recording:
    """An opened recording of any format. Readers stream: nothing here holds more than one message.

    ``sweeps``, ``frames`` and ``messages`` raise :class:`ReadError` where the file's content is not usable.

    Attributes:
        format: name of the file format, for example ``rosbag1``.
        sensors: every LiDAR and camera, in the file's order.
        other_topics: what else the recording holds and no reader takes, for messages to its owner.
    """

    format: str
    sensors: Sequence[Sensor]
    other_topics: Sequence[str] = ()

    @property
    def static_transforms(self) -> Sequence[FixedFrame]:
        """The poses of frames that the recording states to be fixed."""
        return ()

    @property
    def warnings(self) -> list[str]:
        """Sentences for the owner, growing while the recording is read."""
        raise NotImplementedError

    @property
    def share_read(self) -> float | None:
        """Share of the bytes that ``messages`` has passed, 0 to 1, for progress; None where the sensors' counts
        tell it.
        """
        return None

    @property
    def omissions(self) -> Omissions:
        """The messages that ``messages`` left out since it began, because they cannot be used."""
        raise NotImplementedError

    def log_times(self, sensor: Sensor) -> NDArray[np.int64] | None:
        """(N,) times of recording of all messages, ns, from the file's index; None where the file has none."""
        return None

    def log_and_stamp(self, sensor: Sensor, count: int) -> Iterator[tuple[int, int]]:
        """(time of recording, stamp), ns, of some messages spread over the file, where it has both."""
        yield from ()

    def stamps(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, int, int]]:
        """(sensor, stamp, time of recording), ns, of all messages in recorded order, where it has both."""
        yield from ()

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All sensors in one pass over the file, in the order in which they were recorded."""
        raise NotImplementedError

    def samples(self, sensor: Sensor, count: int) -> Iterator[Sweep | Frame]:
        """Yield some sweeps or frames of a sensor, as in ``messages``: the first ones if no others can be read.

        ``omissions`` then has what it left out of this sensor.
        """
        return (item for _, item in islice(self.messages([sensor]), count))

    def sweeps(self, sensor: Sensor) -> Iterator[Sweep]:
        """The sweeps of one LiDAR."""
        return (item for _, item in self.messages([sensor]) if isinstance(item, Sweep))

    def frames(self, sensor: Sensor) -> Iterator[Frame]:
        """The frames of one camera."""
        return (item for _, item in self.messages([sensor]) if isinstance(item, Frame))

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """The facts learned of a LiDAR from a few of its sweeps.

        Raises:
            ReadError: its clouds are not usable, for example ``cloud_without_rings``.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Close all files, and remove what was unpacked."""
