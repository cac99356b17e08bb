"""What a file of topics has to offer: ROS 1 bags, ROS 2 bags and MCAP files alike."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from workers.readers.ros.topic_messages import Decoder, Topic


class Container(Protocol):
    """A file of topics.

    Attributes:
        format: name of the file format.
        warnings: sentences about what was met.
    """

    format: str
    warnings: list[str]

    @property
    def topics(self) -> Sequence[Topic]: ...

    @property
    def share_read(self) -> float | None: ...

    def decoder(self, topic: Topic) -> Decoder | None:
        """How messages of a topic are read, None where they are of no LiDAR and no camera."""
        ...

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """(topic, time of recording, message) of these topics, in recorded order."""
        ...

    def samples(self, name: str, count: int) -> Iterator[tuple[int, bytes]]:
        """(time of recording, message) of some messages spread over the file."""
        ...

    def times(self, name: str) -> NDArray[np.int64]:
        """Times of recording of successive messages of a topic, of all or of many."""
        ...

    def log_times(self, name: str) -> NDArray[np.int64]:
        """Times of recording of all messages of a topic, from the file's index where it has one."""
        ...

    def close(self) -> None: ...
