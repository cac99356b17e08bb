"""Progress of an ingestion: its share, its time left, and its signs of life."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

_EVERY_S: Final = 0.2
_SETTLED_S: Final = 2.0
_SETTLED_SHARE: Final = 0.01


@dataclass(frozen=True, slots=True)
class IngestProgress:
    """A moment of an ingestion.

    Attributes:
        done: messages read.
        total: messages in all, where the format tells.
        share: of the work, 0 to 1, by messages or else by bytes; None where neither is known.
        seconds_left: at the pace so far; None in the first seconds.
    """

    done: int
    total: int | None
    share: float | None
    seconds_left: float | None


OnProgress = Callable[[IngestProgress], None]


class Pace:
    """Turns counts into :class:`IngestProgress` while time passes."""

    def __init__(self, total: int | None) -> None:
        self._total = total
        self._started = time.monotonic()
        self._next = self._started

    @property
    def due(self) -> bool:
        """Whether it is time to tell again."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = now + _EVERY_S
        return True

    def at(self, done: int, share_read: float | None) -> IngestProgress:
        """The progress after ``done`` messages.

        Args:
            done: messages read.
            share_read: of the file's bytes, where counts do not tell.
        """
        share = min(1.0, done / self._total) if self._total else share_read
        spent = time.monotonic() - self._started
        settled = share is not None and share > _SETTLED_SHARE and spent > _SETTLED_S
        left = spent * (1.0 - share) / share if share is not None and settled else None
        return IngestProgress(done, self._total, share, left)


_BEAT_S: Final = 0.5


@dataclass(slots=True)
class _Pulse:
    tell: Callable[[], None] | None = None
    due: float = 0.0


_PULSE: Final = _Pulse()


def tell_beats(tell: Callable[[], None]) -> None:
    """Call ``tell`` with the beats from now on, at most twice a second."""
    _PULSE.tell = tell


def beat() -> None:
    """Say that work goes on, for each piece of it and never from a timer. It costs half a microsecond at most."""
    if _PULSE.tell is not None:
        now = time.monotonic()
        if now >= _PULSE.due:
            _PULSE.due = now + _BEAT_S
            _PULSE.tell()
