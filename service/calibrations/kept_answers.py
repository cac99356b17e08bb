"""Answers of the vehicles' calibrations as bytes, by their ETags. An ETag names one content, so none grows old."""

from __future__ import annotations

from collections import OrderedDict

# 10,000 vehicles of two cameras; a calibration of one camera has about 3 KB.
_MOST_BYTES = 64 * 2**20


class KeptAnswers:
    """The answers that were asked for last. It belongs to one event loop."""

    def __init__(self, most_bytes: int = _MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._bytes = 0
        self._answers: OrderedDict[str, bytes] = OrderedDict()

    def get(self, etag: str) -> bytes | None:
        """The answer, or None."""
        found = self._answers.get(etag)
        if found is not None:
            self._answers.move_to_end(etag)
        return found

    def put(self, etag: str, answer: bytes) -> None:
        """Keep an answer, and forget what was asked for longest ago."""
        self._bytes += len(answer) - len(self._answers.pop(etag, b""))
        self._answers[etag] = answer
        while self._bytes > self._most_bytes:
            self._bytes -= len(self._answers.popitem(last=False)[1])
