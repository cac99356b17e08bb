"""Stamps of messages, topic by topic: which messages have one, and what 0 means."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress

import numpy as np

from workers.readers.clouds.model import SAMPLES
from workers.readers.recording import MessageError
from workers.readers.ros.containers import Container
from workers.readers.ros.topic_messages import Decoder, Message


class MessageStamps:
    """The stamps of a container's messages.

    Args:
        container: open.
        decoders: of its topics.

    Attributes:
        stampless: topics whose messages have no stamps.
    """

    def __init__(self, container: Container, decoders: Mapping[str, Decoder]) -> None:
        self._container, self._decoders = container, decoders
        self._first_stamped_ns: dict[str, int | None] = {}
        self.stampless: set[str] = set()

    def of(self, name: str, message: Message, log_ns: int) -> int:
        """A message's stamp, ns; the time of recording on a topic that has none.

        Raises:
            MessageError: ``stamp_missing``, other messages of the topic have stamps.
        """
        if message.stamp_ns:
            return message.stamp_ns
        if name not in self._first_stamped_ns:
            self._first_stamped_ns[name] = self._clock_start(name)
        first_stamped_ns = self._first_stamped_ns[name]
        if first_stamped_ns is None:
            self.stampless.add(name)
            return log_ns
        if log_ns < first_stamped_ns:
            return 0
        raise MessageError(
            "stamp_missing",
            f"The message on {name} that was recorded at {log_ns / 1e9:.3f} s has the stamp 0; others have stamps.",
            "Look at the driver: it sends messages before its clock is set.",
        )

    def samples(self, name: str, count: int) -> Iterator[tuple[int, int]]:
        """(time of recording, stamp), ns, of some messages that have a stamp."""
        for log_ns, raw in self._container.samples(name, count):
            with suppress(MessageError):
                stamp_ns = self._decoders[name](raw).stamp_ns
                if stamp_ns:
                    yield log_ns, stamp_ns

    def _clock_start(self, name: str) -> int | None:
        """Time of recording, ns, before which a stamp of 0 is a simulated clock's beginning; None without stamps.

        Such a clock begins at 0: its first stamp lies as far from 0 as the others lie from each other.
        """
        pairs = np.array(list(self.samples(name, SAMPLES)), np.int64).reshape(-1, 2)
        if not len(pairs):
            return None
        stamps = pairs[:, 1]
        return int(pairs[:, 0].min()) if stamps.min() <= 1.5 * stamps.max() / len(stamps) else 0
