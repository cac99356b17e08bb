"""Files of topics: ROS 1 bags, ROS 2 bags and MCAP files alike, and several of them one after the other."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from importlib import import_module
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import MessageError, ReadError
from workers.readers.ros.ros_types import ros_decoder
from workers.readers.ros.topic_messages import BagTopic, Decoder, Message

_Item = TypeVar("_Item")


class Container:
    """A file of topics.

    Attributes:
        format: name of the file format.
        size: bytes.
        topics: in the order of the file.
        warnings: sentences about what was met when it was opened.
    """

    format: str
    size: int
    topics: Sequence[BagTopic]
    warnings: list[str]

    @property
    def share_read(self) -> float | None:
        """Share of the bytes that ``messages`` has passed; None where the topics' counts tell it."""
        return None

    def damage(self) -> AbstractContextManager[None]:
        """Turn what libraries raise on damaged bytes into ``recording_damaged``."""
        raise NotImplementedError

    def decoder(self, topic: BagTopic) -> Decoder | None:
        """Return how messages of a topic are read, None where they are of no LiDAR and no camera."""
        own = topic.type.startswith("foxglove.")  # their classes take 20 ms to load
        decode = import_module("workers.readers.ros.foxglove").foxglove_decoder(topic) if own else ros_decoder(topic)
        if decode is None:
            return None

        def guarded(raw: bytes) -> Message:
            try:
                with self.damage():
                    return decode(raw)
            except ReadError as error:
                message = f"A message on {topic.name} cannot be decoded. {error.message}"
                raise MessageError(error.code, message, error.hint, error.fields) from error

        return guarded

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Yield (topic, time of recording, message) of these topics, in recorded order."""
        raise NotImplementedError

    def samples(self, name: str, count: int) -> Iterator[tuple[int, bytes]]:
        """Yield (time of recording, message) of some messages spread over the file."""
        raise NotImplementedError

    def times(self, name: str) -> NDArray[np.int64]:
        """Return times of recording of successive messages of a topic, of all or of many."""
        raise NotImplementedError

    def log_times(self, name: str) -> NDArray[np.int64]:
        """Return times of recording of all messages of a topic, from the file's index where it has one."""
        raise NotImplementedError

    def close(self) -> None:
        """Close the file."""
        raise NotImplementedError


class SplitContainer(Container):
    """The files of a recording that was split while it was recorded, one after the other.

    Args:
        files: open, in order; closed with this.
        warnings: sentences about files that are missing.
        after: closed after the files.
    """

    def __init__(
        self, files: Sequence[Container], warnings: Sequence[str] = (), after: ExitStack | None = None
    ) -> None:
        self._files = files
        self._after = after or ExitStack()
        self._index = 0
        self.format = files[0].format
        self.size = sum(file.size for file in files)
        self.warnings = list(dict.fromkeys([*warnings, *(line for file in files for line in file.warnings)]))
        topics: dict[str, BagTopic] = {}
        for topic in (topic for file in files for topic in file.topics):
            before = topics.setdefault(topic.name, topic)
            if before is not topic and before.count is not None:
                count = None if topic.count is None else before.count + topic.count
                topics[topic.name] = replace(before, count=count)
        self.topics = list(topics.values())

    @property
    def share_read(self) -> float | None:
        """Share by the files' sizes."""
        if self._index == len(self._files):
            return 1.0
        share = self._files[self._index].share_read
        if share is None:
            return None
        before = sum(file.size for file in self._files[: self._index])
        return (before + share * self._files[self._index].size) / max(1, self.size)

    def damage(self) -> AbstractContextManager[None]:
        """Name the file that is read."""
        return self._files[min(self._index, len(self._files) - 1)].damage()

    def _with_topic(self, name: str) -> list[Container]:
        return [file for file in self._files if any(topic.name == name for topic in file.topics)]

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """See :class:`Container`."""
        for index, file in enumerate(self._files):
            self._index = index
            here = {topic.name for topic in file.topics} & set(names)
            if here:
                yield from file.messages(here)
        self._index = len(self._files)

    def samples(self, name: str, count: int) -> Iterator[tuple[int, bytes]]:
        """See :class:`Container`."""
        files = spread(self._with_topic(name), count)
        for number, file in enumerate(files):
            yield from file.samples(name, (number + 1) * count // len(files) - number * count // len(files))

    def times(self, name: str) -> NDArray[np.int64]:
        """See :class:`Container`."""
        return next((file.times(name) for file in self._with_topic(name)), np.zeros(0, np.int64))

    def log_times(self, name: str) -> NDArray[np.int64]:
        """See :class:`Container`."""
        return np.concatenate([np.zeros(0, np.int64), *(file.log_times(name) for file in self._with_topic(name))])

    def close(self) -> None:
        """Close all files, and remove what was unpacked."""
        for file in self._files:
            file.close()
        self._after.close()


def spread(items: Sequence[_Item], count: int) -> list[_Item]:
    """Return at most ``count`` of the items, evenly spread, the first and the last among them."""
    if len(items) <= count:
        return list(items)
    return [items[round(i)] for i in np.linspace(0, len(items) - 1, count).tolist()] if count else []
