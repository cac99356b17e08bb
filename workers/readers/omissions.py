"""Messages that cannot be used: each is left out and counted, by topic and reason; one list names them."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.omissions import Omission
from workers.readers.recording import MessageError, ReadError, legible

# By error code: the noun for messages, and the reason in words for one and for several of them.
_REASONS: Final[Mapping[str, tuple[str, str, str]]] = {
    "cloud_empty": ("clouds", "is empty", "are empty"),
    "cloud_malformed": ("clouds", "is no valid cloud", "are no valid clouds"),
    "cloud_truncated": ("clouds", "is cut short", "are cut short"),
    "cloud_without_xyz": ("clouds", "has no x, y and z", "have no x, y and z"),
    "cloud_fields_differ": ("clouds", "lacks fields of the others", "lack fields of the others"),
    "image_empty": ("frames", "is empty", "are empty"),
    "image_damaged": ("frames", "is damaged or cut short", "are damaged or cut short"),
    "image_unsupported": ("frames", "is no image that is read", "are no images that are read"),
    "image_encoding_unsupported": ("frames", "has a pixel format not read", "have a pixel format not read"),
    "image_too_large": ("frames", "is too large", "are too large"),
    "image_turned": ("frames", "is turned by its Exif orientation", "are turned by their Exif orientation"),
    "image_size_differs": ("frames", "has another size", "have another size"),
    "video_damaged": ("frames", "cannot be decoded", "cannot be decoded"),
    "recording_damaged": ("messages", "cannot be decoded", "cannot be decoded"),
    "stamp_missing": ("messages", "has the stamp 0", "have the stamp 0"),
    "stamp_out_of_range": (
        *("messages", "has a stamp before 1970 or after 2038", "have stamps before 1970 or after 2038"),
    ),
    "lens_not_stated": ("CameraInfo", "is not filled in yet", "are not filled in yet"),
}
_Item = TypeVar("_Item")
_OTHER: Final = ("messages", "cannot be used", "cannot be used")


@dataclass(slots=True)
class _Tally:
    """Messages of one topic that were left out for one reason.

    ``total``: messages that were looked at, if no sensor is read from the topic. ``everything``: all its messages.
    """

    error: MessageError
    count: int = 0
    total: int | None = None
    everything: int = 0
    stamps: array[int] = field(default_factory=lambda: array("q"))


class Omissions:
    """The messages that a reader left out so far."""

    def __init__(self) -> None:
        self._tallies: dict[tuple[str, str], _Tally] = {}

    def clear(self, topics: Iterable[str]) -> None:
        """Forget the omissions of these topics, because they are read again from their beginning."""
        names = set(topics)
        self._tallies = {key: tally for key, tally in self._tallies.items() if key[0] not in names}

    def add(
        self,
        topic: str,
        error: MessageError,
        stamp_ns: int | None = None,
        *,
        count: int = 1,
        total: int | None = None,
        everything: int | None = None,
    ) -> None:
        """Count messages of a topic that cannot be used.

        Args:
            topic: the sensor's name for it.
            error: the first message's.
            stamp_ns: of the message, if it has one.
            count: number of messages.
            total: number of messages that were looked at, if no sensor is read from the topic.
            everything: number of messages of that topic.
        """
        tally = self._tallies.setdefault((topic, error.code), _Tally(error))
        tally.count += count
        tally.total, tally.everything = total, everything or 0
        if stamp_ns is not None:
            tally.stamps.append(stamp_ns)

    @contextmanager
    def leaving_out(self, topic: str, stamp_ns: int | None = None) -> Generator[None]:
        """Leave a message out if reading it raises :class:`MessageError`."""
        try:
            yield
        except MessageError as error:
            self.add(topic, error, stamp_ns)

    def update(self, other: Omissions, names: Mapping[str, str] | None = None) -> None:
        """Add the omissions of a part of the recording; ``names`` maps its topics to this recording's."""
        for (topic, code), tally in other._tallies.items():
            name = names.get(topic, topic) if names else topic
            self.add(name, tally.error, count=tally.count, total=tally.total, everything=tally.everything)
            self._tallies[name, code].stamps.extend(tally.stamps)

    def count(self, topic: str, code: str) -> int:
        """Return how many messages of a topic were left out for this reason."""
        return self._tallies[topic, code].count if (topic, code) in self._tallies else 0

    def stamps(self, topic: str) -> NDArray[np.int64]:
        """Return (N,) the known stamps, ns, of the messages left out of a topic."""
        every = (tally.stamps for (name, _), tally in self._tallies.items() if name == topic)
        return np.concatenate([np.zeros(0, np.int64), *(np.array(stamps, np.int64) for stamps in every)])

    def documents(self, counts: Mapping[str, int], everything: Mapping[str, int] | None = None) -> list[Omission]:
        """Return all omissions.

        Args:
            counts: number of messages taken, by topic.
            everything: number of messages of a topic, if not all were looked at.
        """
        totals = Counter(counts)
        for (topic, _), tally in self._tallies.items():
            totals[topic] += tally.count
        return [
            _document(topic, code, tally, tally.total or totals[topic], (everything or {}).get(topic))
            for (topic, code), tally in self._tallies.items()
        ]

    def refusal(self, topic: str) -> ReadError | None:
        """Return the most frequent reason why nothing of a topic was taken; None if nothing was left out of it."""
        tallies = [tally for (name, _), tally in self._tallies.items() if name == topic]
        if not tallies:
            return None
        worst, count = max(tallies, key=lambda tally: tally.count), sum(tally.count for tally in tallies)
        if count == 1:
            return worst.error
        error = worst.error
        message = f"None of the {count} messages of {topic} can be used. {error.message}"
        return ReadError(error.code, message, error.hint, error.fields)


def readable(reads: Iterable[Callable[[], _Item]]) -> Iterator[_Item]:
    """Yield the messages that can be read.

    Raises:
        MessageError: that of the first message, if none can be read.
    """
    error: MessageError | None = None
    count = 0
    for read in reads:
        try:
            item = read()
        except MessageError as reason:
            error = error or reason
            continue
        count += 1
        yield item
    if error is not None and not count:
        raise error


def _document(topic: str, code: str, tally: _Tally, total: int, everything: int | None) -> Omission:
    noun, single, plural = _REASONS.get(code, _OTHER)
    looked_at = " that were looked at" if total < (everything or tally.everything) else ""
    phrase = single if tally.count == 1 else plural
    sentence = f"{topic}: {tally.count} of {total} {noun}{looked_at} {phrase}: left out."
    return Omission(
        topic=legible(topic),
        code=code,
        count=tally.count,
        total=total,
        sentence=legible(sentence),
        example=tally.error.message,
    )
