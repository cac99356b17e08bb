"""The writing side of a normalised recording: one MCAP file per sensor, message types that Foxglove shows."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.clouds.pointcloud2 import empty_cloud
from workers.readers.mcap_io.writer import McapWriter
from workers.readers.normalised.cdr import encode_image, encode_points
from workers.readers.normalised.lidar_file import FACTS, METADATA_NAME
from workers.readers.recording import Frame, LidarFacts, MessageError, Sweep
from workers.readers.ros.ros_types import CLOUD, COMPRESSED, fixed_types

# Of 18,701 points of a VLP-16 (449 kB): level 3 takes 2.0 ms and leaves 63 %, level 1 takes 1.2 ms and leaves 65 %,
# level -1 takes 0.95 ms and leaves 69 %, and unpacks in half the time of the others (0.24 ms).
_LEVEL: Final = -1
# Pixels of 20 megapixels, 24 bits each, as they are; PNG and JPEG take less. Who looks at a frame is sent it whole.
MAX_FRAME_BYTES: Final = 64 * 1024**2


def check_stamp(stamp_ns: int, topic: str) -> None:
    """Refuse a stamp that the messages' time (int32 seconds since 1970) cannot hold.

    Raises:
        MessageError: ``stamp_out_of_range``.
    """
    if not 0 <= stamp_ns < 2**31 * 1_000_000_000:
        raise MessageError(
            "stamp_out_of_range",
            f"{topic} has the stamp {stamp_ns} ns, which lies before 1970 or after 2038.",
            "Stamps are nanoseconds since 1970, UTC; look at the recorder's clock or at the unit of the stamps.",
        )


def check_item(item: Sweep | Frame, topic: str) -> None:
    """Refuse a sweep or a frame that no file holds.

    Raises:
        MessageError: ``stamp_out_of_range``, ``cloud_empty``, ``image_too_large``.
    """
    check_stamp(item.stamp_ns, topic)
    if isinstance(item, Sweep) and not len(item.xyz):
        raise empty_cloud(f"{topic}: the sweep at {item.stamp_ns / 1e9:.3f} s")
    if isinstance(item, Frame) and len(item.data) > MAX_FRAME_BYTES:
        raise MessageError(
            "image_too_large",
            f"A frame of {topic} takes {len(item.data)} bytes; {MAX_FRAME_BYTES} are the most.",
            "Record the camera's frames smaller, or as JPEG.",
        )


class _SensorFile:
    """A file of one channel of ROS 2 messages."""

    def __init__(self, path: Path, topic: str, frame_id: str, kind: str, compression: str) -> None:
        self.path, self.topic, self.frame_id = path, topic, frame_id
        self._file = McapWriter(path, "ros2", compression, _LEVEL)
        definition, _ = fixed_types("cdr").generate_msgdef(kind, ros_version=2)
        schema = self._file.add_schema(kind, "ros2msg", definition.encode())
        self._channel = self._file.add_channel(topic, schema, "cdr")

    def _finish(self, **facts: object) -> None:
        facts = {"topic": self.topic, "frame_id": self.frame_id, **facts}
        self._file.add_metadata(METADATA_NAME, {name: str(value) for name, value in facts.items()})
        self._file.finish()

    def abandon(self) -> None:
        """Close without finishing; what is on disk is of no use."""
        self._file.abandon()


class LidarWriter(_SensorFile):
    """Writes ``lidar.mcap``: ``sensor_msgs/msg/PointCloud2`` in zstd chunks, read by :class:`LidarFile`."""

    def __init__(self, path: Path, topic: str, frame_id: str) -> None:
        super().__init__(path, topic, frame_id, CLOUD, "zstd")

    def add(self, sweep: Sweep) -> None:
        """Append one sweep that :func:`check_item` passed; stamps need not ascend.

        Raises:
            OverflowError: a point lies more than 2.1 s from its sweep's stamp.
        """
        self._file.add(self._channel, sweep.stamp_ns, encode_points(sweep, self.frame_id))

    def finish(self, facts: LidarFacts, stamps_ns: NDArray[np.int64] | None = None) -> None:
        """Write index and facts, and close. ``stamps_ns``: (N,) in the order added, where they are to be others."""
        more = {} if stamps_ns is None else {"stamps_ns": " ".join(map(str, stamps_ns.tolist()))}
        self._finish(**{name: getattr(facts, name) for name in FACTS}, **more)


class CameraWriter(_SensorFile):
    """Writes ``camera-<name>.mcap``: ``sensor_msgs/msg/CompressedImage``, uncompressed, so that each frame is a
    byte range of the file.
    """

    def __init__(self, path: Path, topic: str, frame_id: str) -> None:
        super().__init__(path, topic, frame_id, COMPRESSED, "")
        self.lengths = array("q")

    def add(self, frame: Frame) -> None:
        """Append one frame that :func:`check_item` passed; stamps need not ascend."""
        message = encode_image(frame.stamp_ns, self.frame_id, frame.media_type, frame.data)
        self._file.add(self._channel, frame.stamp_ns, message)
        self.lengths.append(len(frame.data))

    def finish(self) -> array[int]:
        """Write the index and close; the byte offset of every frame's data in the file, in the order added."""
        self._finish()
        return array("q", (end - length for end, length in zip(self._file.ends, self.lengths, strict=True)))
