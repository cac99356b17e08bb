"""Answers of the vehicles' calibrations as bytes, by their ETags. An ETag names one content, so none grows old."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import NamedTuple

# 10,000 vehicles of two cameras; a calibration of one camera has about 3 KB.
_MOST_BYTES = 64 * 2**20


class KeptAnswer(NamedTuple):
    """An answer with its headers, the hash of its content among them."""

    content: bytes
    headers: Mapping[str, str]


class KeptAnswers:
    """The answers that were asked for last. It belongs to one event loop."""

    def __init__(self, most_bytes: int = _MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._bytes = 0
        self._answers: OrderedDict[str, KeptAnswer] = OrderedDict()

    def get(self, etag: str) -> KeptAnswer | None:
        """The answer, or None."""
        found = self._answers.get(etag)
        if found is not None:
            self._answers.move_to_end(etag)
        return found

    def put(self, etag: str, answer: KeptAnswer) -> None:
        """Keep an answer, and forget what was asked for longest ago."""
        before = self._answers.pop(etag, None)
        self._bytes += len(answer.content) - (len(before.content) if before else 0)
        self._answers[etag] = answer
        while self._bytes > self._most_bytes:
            self._bytes -= len(self._answers.popitem(last=False)[1].content)
