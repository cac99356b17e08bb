"""The writing side of a normalised recording: one MCAP file per sensor, message types that Foxglove shows."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any, Final

from mcap.writer import CompressionType, Writer

from workers.readers.mcap_io.records import HEAD
from workers.readers.normalised.cdr import encode_image, encode_points
from workers.readers.normalised.lidar_file import FACTS, METADATA_NAME
from workers.readers.output import create
from workers.readers.recording import Frame, LidarFacts, ReadError, Sweep
from workers.readers.ros.ros_types import CLOUD, COMPRESSED, fixed_types

# Pixels of 20 megapixels, 24 bits each, as they are; PNG and JPEG take less. Who looks at a frame is sent it whole.
MAX_FRAME_BYTES: Final = 64 * 1024**2
_INDEX_BYTES: Final = HEAD.size + 2 + 4 + 16  # of a chunk of one message: channel, length, time and place


def check_stamp(stamp_ns: int, topic: str) -> None:
    """Refuse a stamp that the messages' time (int32 seconds since 1970) cannot hold.

    Raises:
        ReadError: ``stamp_out_of_range``.
    """
    if not 0 <= stamp_ns < 2**31 * 1_000_000_000:
        raise ReadError(
            "stamp_out_of_range",
            f"{topic} has the stamp {stamp_ns} ns, which lies before 1970 or after 2038.",
            "Stamps are nanoseconds since 1970, UTC; look at the recorder's clock or at the unit of the stamps.",
        )


class _SensorFile:
    """A file of one channel of ROS 2 messages."""

    def __init__(self, path: Path, topic: str, frame_id: str, kind: str, **how: Any) -> None:
        self.path, self.topic, self.frame_id = path, topic, frame_id
        self.stream = create(path)
        self._file = Writer(self.stream, **how)
        self._file.start("ros2", "apexcal")
        definition, _ = fixed_types("cdr").generate_msgdef(kind, ros_version=2)
        schema = self._file.register_schema(kind, "ros2msg", definition.encode())
        self._channel = self._file.register_channel(topic, "cdr", schema)

    def _add(self, stamp_ns: int, message: memoryview) -> None:
        self._file.add_message(self._channel, stamp_ns, bytes(message), stamp_ns)

    def _finish(self, **facts: object) -> None:
        facts = {"topic": self.topic, "frame_id": self.frame_id, **facts}
        self._file.add_metadata(METADATA_NAME, {name: str(value) for name, value in facts.items()})
        self._file.finish()
        self.stream.close()


class LidarWriter(_SensorFile):
    """Writes ``lidar.mcap``: ``sensor_msgs/msg/PointCloud2`` in zstd chunks, read by :class:`LidarFile`."""

    def __init__(self, path: Path, topic: str, frame_id: str) -> None:
        super().__init__(path, topic, frame_id, CLOUD)

    def add(self, sweep: Sweep) -> None:
        """Append one sweep; stamps need not ascend.

        Raises:
            ReadError: ``stamp_out_of_range``.
            OverflowError: a point lies more than 2.1 s from its sweep's stamp.
        """
        check_stamp(sweep.stamp_ns, self.topic)
        self._add(sweep.stamp_ns, encode_points(sweep, self.frame_id))

    def finish(self, facts: LidarFacts) -> None:
        """Write index and facts, and close."""
        self._finish(**{name: getattr(facts, name) for name in FACTS})


class CameraWriter(_SensorFile):
    """Writes ``camera-<name>.mcap``: ``sensor_msgs/msg/CompressedImage``, uncompressed, so that each frame is a
    byte range of the file.

    Attributes:
        offsets, lengths: bytes at which each frame's data begin in the file, and how many they are.
    """

    def __init__(self, path: Path, topic: str, frame_id: str) -> None:
        # Each frame is a chunk of its own, and so ends where the index of its chunk begins.
        super().__init__(path, topic, frame_id, COMPRESSED, compression=CompressionType.NONE, chunk_size=1)
        self.offsets, self.lengths = array("q"), array("q")

    def add(self, frame: Frame) -> None:
        """Append one frame; stamps need not ascend.

        Raises:
            ReadError: ``stamp_out_of_range``, ``image_too_large``.
        """
        check_stamp(frame.stamp_ns, self.topic)
        size = len(frame.data)
        if size > MAX_FRAME_BYTES:
            raise ReadError(
                "image_too_large",
                f"A frame of {self.topic} takes {size} bytes; {MAX_FRAME_BYTES} are the most.",
                "Record the camera's frames smaller, or as JPEG.",
            )
        self._add(frame.stamp_ns, encode_image(frame.stamp_ns, self.frame_id, frame.media_type, frame.data))
        self.offsets.append(self.stream.tell() - _INDEX_BYTES - size)
        self.lengths.append(size)

    def finish(self) -> None:
        """Write the index and close."""
        self._finish()
