"""ROS 1 bags, through the rosbags library."""

from __future__ import annotations

import struct
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from workers.readers.clouds import SAMPLES, CloudModel, Columns, learn_clouds
from workers.readers.images import read_image_header
from workers.readers.pointcloud2 import cloud_columns
from workers.readers.recording import Frame, LidarFacts, ReadError, ReadOptions, Sensor, Sweep
from workers.readers.transcode import raw_to_png

_CLOUD: Final = "sensor_msgs/msg/PointCloud2"
_IMAGE: Final = "sensor_msgs/msg/Image"
_COMPRESSED: Final = "sensor_msgs/msg/CompressedImage"
_MAGIC: Final = b"#ROSBAG V2.0\n"
_TYPES: Final = get_typestore(Stores.ROS1_NOETIC)


class Rosbag1Recording:
    """A ROS 1 bag: ``sensor_msgs`` PointCloud2, Image and CompressedImage topics.

    JPEG, PNG and WebP images are handed on byte for byte; raw images become PNG.

    Raises:
        ReadError: ``recording_truncated``, ``recording_not_indexed``, ``recording_damaged``.
    """

    format = "rosbag1"

    @staticmethod
    def recognises(path: Path, head: bytes) -> bool:
        """Whether the file's first bytes are those of a ROS 1 bag."""
        return path.is_file() and head.startswith(_MAGIC)

    def __init__(self, path: Path, options: ReadOptions) -> None:
        _check_ends(path)
        self._path = path
        self._options = options
        self._bag = Reader(path)
        self._models: dict[str, CloudModel] = {}
        self._stampless: set[str] = set()
        self._connections: dict[str, list[Connection]] = {}
        self._other_topics: list[str] = []
        try:
            with _damage(path):
                self._bag.open()
            self._sensors = self._find_sensors()
        except BaseException:
            self.close()
            raise

    def _find_sensors(self) -> list[Sensor]:
        for connection in self._bag.connections:
            if connection.msgtype in (_CLOUD, _IMAGE, _COMPRESSED):
                self._connections.setdefault(connection.topic, []).append(connection)
            else:
                self._other_topics.append(f"{connection.topic} ({connection.msgtype})")
        return [self._sensor(topic) for topic in self._connections]

    @property
    def sensors(self) -> Sequence[Sensor]:
        """Every topic that is a LiDAR's or a camera's, in the bag's order."""
        return self._sensors

    @property
    def other_topics(self) -> Sequence[str]:
        """The bag's remaining topics with their types."""
        return self._other_topics

    @property
    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        said = [sentence for model in self._models.values() for sentence in model.warnings()]
        said.extend(
            f"{topic}: messages have no stamp of their own; the time of recording was taken."
            for topic in sorted(self._stampless)
        )
        return said

    def _sensor(self, topic: str) -> Sensor:
        connections = self._connections[topic]
        count = sum(c.msgcount for c in connections)
        frame_id, fields = "", ""
        with _damage(self._path):
            first = next(self._bag.messages(connections), None) if count else None
            if first is not None:
                message = _deserialize(first[0], first[2])
                frame_id = str(message.header.frame_id)
                if connections[0].msgtype == _CLOUD:
                    fields = " ".join(f.name for f in message.fields)
        if connections[0].msgtype == _CLOUD:
            return Sensor("lidar", topic, frame_id, count, {"fields": fields})
        return Sensor("camera", topic, frame_id, count, {"type": connections[0].msgtype})

    @property
    def share_read(self) -> float | None:
        """None: the number of messages is known beforehand."""
        return None

    def lidar_facts(self, sensor: Sensor) -> LidarFacts:
        """What was learned of a LiDAR from sweeps spread over the bag."""
        return self._model(sensor).facts

    def _model(self, sensor: Sensor) -> CloudModel:
        if sensor.name not in self._models:
            connections = self._connections[sensor.name]
            times = np.array(sorted(entry.time for c in connections for entry in self._bag.indexes[c.id]), np.int64)
            period = int(np.median(np.diff(times))) if len(times) > 2 else None
            with _damage(self._path):
                model = learn_clouds(self._samples(sensor, times), period, self._options, sensor.name)
            self._models[sensor.name] = model
        return self._models[sensor.name]

    def _samples(self, sensor: Sensor, times: Any) -> Iterator[tuple[int, Columns]]:
        connections = self._connections[sensor.name]
        chosen = np.unique(np.linspace(0, len(times) - 1, min(SAMPLES, len(times))).astype(int))
        for time in times[chosen].tolist():
            for connection, log_ns, raw in self._bag.messages(connections, start=time, stop=time + 1):
                message = _deserialize(connection, raw)
                stamp_ns = self._stamp(sensor.name, message.header.stamp, log_ns)
                yield stamp_ns, cloud_columns(message, _where(sensor.name, stamp_ns))
                break

    def sweeps(self, sensor: Sensor) -> Iterator[Sweep]:
        """The sweeps of one LiDAR in recorded order."""
        for _, item in self.messages([sensor]):
            if isinstance(item, Sweep):
                yield item

    def frames(self, sensor: Sensor) -> Iterator[Frame]:
        """The frames of one camera in recorded order."""
        for _, item in self.messages([sensor]):
            if isinstance(item, Frame):
                yield item

    def messages(self, sensors: Sequence[Sensor]) -> Iterator[tuple[Sensor, Sweep | Frame]]:
        """All chosen topics in one pass, in recorded order."""
        by_name = {sensor.name: sensor for sensor in sensors}
        models = {sensor.name: self._model(sensor) for sensor in sensors if sensor.kind == "lidar"}
        connections = [c for name in by_name for c in self._connections[name]]
        if not connections:
            return
        with _damage(self._path):
            for connection, log_ns, raw in self._bag.messages(connections):
                sensor = by_name[connection.topic]
                yield sensor, self._item(sensor, connection, log_ns, raw, models)

    def _item(
        self, sensor: Sensor, connection: Connection, log_ns: int, raw: bytes, models: dict[str, CloudModel]
    ) -> Sweep | Frame:
        message = _deserialize(connection, raw)
        stamp_ns = self._stamp(sensor.name, message.header.stamp, log_ns)
        where = _where(sensor.name, stamp_ns)
        if connection.msgtype == _CLOUD:
            return models[sensor.name].sweep(stamp_ns, cloud_columns(message, where))
        if connection.msgtype == _COMPRESSED:
            data = message.data.tobytes()
            header = read_image_header(data, where)
            return Frame(stamp_ns, data, header.media_type, header.width, header.height)
        return raw_to_png(
            message.data,
            width=message.width,
            height=message.height,
            step=message.step,
            encoding=message.encoding,
            stamp_ns=stamp_ns,
            where=where,
        )

    def _stamp(self, topic: str, stamp: Any, log_ns: int) -> int:
        stamp_ns = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
        if stamp_ns == 0:
            self._stampless.add(topic)
            return log_ns
        return stamp_ns

    def close(self) -> None:
        """Close the bag."""
        if self._bag.bio is not None:
            self._bag.close()


def _where(topic: str, stamp_ns: int) -> str:
    return f"The message on {topic} at {stamp_ns / 1e9:.3f} s"


def _deserialize(connection: Connection, raw: bytes) -> Any:  # a class that rosbags makes at run time
    return _TYPES.deserialize_ros1(raw, connection.msgtype)


def _check_ends(path: Path) -> None:
    """Look for the bag's index before anything else is read.

    Raises:
        ReadError: ``recording_truncated``, ``recording_not_indexed``, ``recording_damaged``.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(8192)
    place = head.find(b"index_pos=", len(_MAGIC))
    if place < 0 or place + 18 > len(head):
        if size < 4096 + len(_MAGIC):
            raise _truncated(path, f"it ends after {size} bytes, inside its first record")
        raise _damaged(path, "its first record has no index_pos")
    (index_at,) = struct.unpack_from("<Q", head, place + 10)
    if index_at == 0:
        raise ReadError(
            "recording_not_indexed",
            f"{path.name} was not closed: its header says that no index was written ({size} bytes).",
            "Run `rosbag reindex` on it (a file ending in .active is one that was still being recorded), "
            "then upload the result.",
        )
    if index_at >= size:
        raise _truncated(
            path, f"it ends at byte {size}, but its index should stand at byte {index_at}; what follows is missing"
        )


def _truncated(path: Path, why: str) -> ReadError:
    return ReadError(
        "recording_truncated",
        f"{path.name} is cut short: {why}.",
        "Copy or upload the file again and compare its size with the original's. "
        "If the original is cut short too, `rosbag reindex` recovers what is there.",
    )


def _damaged(path: Path, why: str) -> ReadError:
    return ReadError(
        "recording_damaged",
        f"{path.name} is a ROS 1 bag but cannot be read: {why}.",
        "Try `rosbag check` and `rosbag reindex` on it; if they fail too, record or copy it again.",
    )


@contextmanager
def _damage(path: Path) -> Generator[None]:
    """Whatever rosbags raises on broken bytes, as a ReadError with a sentence."""
    try:
        yield
    except ReaderError as error:
        why = str(error).rstrip(".")
        if "requested" in why or "Could not read" in why or "could not be read from file" in why:
            raise _truncated(path, why) from error
        raise _damaged(path, why) from error
    except (AssertionError, struct.error, IndexError, KeyError, EOFError, UnicodeDecodeError, ValueError) as error:
        raise _damaged(path, f"its records contradict each other ({type(error).__name__} {error})") from error
    except SerdeError as error:
        raise _damaged(path, f"a message is not what its topic's type says ({error})") from error
    except RuntimeError as error:  # lz4
        raise _damaged(path, f"a compressed chunk does not decompress ({error})") from error
    except OSError as error:  # bz2 raises it without an errno; anything else is the disk's
        if error.errno is not None:
            raise
        raise _damaged(path, f"a compressed chunk does not decompress ({error})") from error
