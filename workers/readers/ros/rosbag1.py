"""ROS 1 bags, through the rosbags library."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import Chunk, Header
from rosbags.serde import SerdeError

from apexcal.documents.readings import ReadOptions
from workers.readers.damage import damage, on_error
from workers.readers.progress import beat
from workers.readers.recording import ReadError
from workers.readers.ros.containers import Container, spread
from workers.readers.ros.topic_messages import BagTopic
from workers.readers.ros.topics import TopicRecording

_WHAT: Final = "a ROS 1 bag"
_HINT: Final = "Try `rosbag check` and `rosbag reindex` on it; if they fail too, record or copy it again."


class Rosbag1Recording(TopicRecording):
    """A ROS 1 bag: PointCloud2, VelodyneScan, Image, CompressedImage and CameraInfo topics.

    Raises:
        ReadError: ``recording_truncated``, ``recording_not_indexed``, ``recording_damaged``.
    """

    def __init__(self, path: Path, options: ReadOptions) -> None:
        super().__init__(Rosbag1Bag(path), options)


class _Reader(Reader):
    """Says that it goes on while it reads the index of a long bag, and notes how the last chunk is compressed."""

    compression = "none"

    def read_chunk(self) -> Chunk:
        """The head of a chunk."""
        beat()
        if self.bio is not None:
            offset = self.bio.tell()
            self.compression = Header.read(self.bio).get_string("compression")
            self.bio.seek(offset)
        return super().read_chunk()


class Rosbag1Bag(Container):
    """A ROS 1 bag as a container of topics. ``reader`` is rosbags' own."""

    format = "rosbag1"

    def __init__(self, path: Path) -> None:
        self._path = path
        self.warnings = []
        self.size = path.stat().st_size
        self.reader = _Reader(path)
        self._connections: dict[str, list[Connection]] = {}
        with on_error(self.close), self.damage():
            self.reader.open()
            for connection in self.reader.connections:
                self._connections.setdefault(connection.topic, []).append(connection)
            self._check_index()
        self.topics = [
            BagTopic(
                *(name, connections[0].msgtype, "ros1", connections[0].msgdef.data, "ros1msg"),
                sum(connection.msgcount for connection in connections),
            )
            for name, connections in self._connections.items()
        ]

    def _check_index(self) -> None:
        """Refuse an index that names a message twice: a small bag would be read without end.

        Raises:
            ReaderError: it does.
        """
        for entries in self.reader.indexes.values():
            if len({(entry.chunk_pos, entry.offset) for entry in entries}) < len(entries):
                raise ReaderError("its index names the same message more than once")

    @contextmanager
    def damage(self) -> Generator[None]:
        """Turn what rosbags raises on damaged bytes into a ReadError."""
        with damage(self._path.name, _WHAT, _HINT, ReaderError, SerdeError):
            try:
                yield
            except ReaderError as error:
                why = str(error).rstrip(".")
                if "not indexed" in why:
                    raise ReadError(
                        "recording_not_indexed",
                        f"{self._path.name} was not closed: its header says that no index was written.",
                        "Run `rosbag reindex` on it (a file ending in .active is one that was still being recorded), "
                        "then upload the result.",
                    ) from error
                if "requested" in why or "Could not read" in why or "could not be read from file" in why:
                    raise ReadError(
                        "recording_truncated",
                        f"{self._path.name} is cut short: {why}.",
                        "Copy or upload the file again and compare its size with the original's. If the original is "
                        "cut short too, `rosbag reindex` recovers what is there.",
                    ) from error
                raise

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """See :class:`Container`."""
        connections = [c for name in names for c in self._connections[name]]
        with self.damage():
            for connection, log_ns, raw in self.reader.messages(connections):
                yield connection.topic, log_ns, raw

    def samples(self, name: str, count: int) -> Iterator[tuple[int, bytes]]:
        """See :class:`Container`."""
        connections = self._connections[name]
        with self.damage():
            for time in spread(sorted(self.times(name).tolist()), count):
                for _, log_ns, raw in self.reader.messages(connections, start=time, stop=time + 1):
                    yield log_ns, raw
                    break

    def times(self, name: str) -> NDArray[np.int64]:
        """See :class:`Container`."""
        entries = (entry.time for c in self._connections[name] for entry in self.reader.indexes[c.id])
        return np.fromiter(entries, np.int64)

    log_times = times

    def close(self) -> None:
        """Close the bag."""
        if self.reader.bio is not None:
            self.reader.close()
