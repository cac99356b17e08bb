"""A child process whose output is read with a timeout, and that its starter can end at once."""

from __future__ import annotations

import os
import selectors
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Final, NamedTuple

from apexcal.processes import has_ended, kill_session

_LOOK_S: Final = 0.2
_PIECE_BYTES: Final = 1 << 16
# The longest line is a manifest: hundreds of sentences and gaps of each sensor. Progress takes 3 MB an hour.
_LINE_BYTES: Final = 8 * 1024**2
_SPOKEN_BYTES: Final = 16 * 1024**2
_COMPLAINT_BYTES: Final = 4000
_LAST_BREATH_S: Final = 10.0


class TalksTooMuchError(Exception):
    """The child said more than this process is ready to keep."""


class ChildEnd(NamedTuple):
    """The end of a child.

    Attributes:
        code: its exit code; below 0 the signal that ended it.
        complaint: the end of what it wrote to stderr.
    """

    code: int
    complaint: str


def supervise(
    command: Sequence[str],
    *,
    folder: Path,
    environment: Mapping[str, str],
    take: Callable[[bytes], None],
    look: Callable[[], None],
) -> ChildEnd:
    """Start a child in a session of its own and stay with it until it ends.

    Args:
        take: called with every line of its stdout.
        look: called five times a second, whether it speaks or not. What either raises kills the child and all that
            it started, and comes out of here.

    Raises:
        TalksTooMuchError: a line, or all lines together, are too long.
    """
    child = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=folder,
        env=environment,
        start_new_session=True,
    )
    assert child.stdout is not None and child.stderr is not None
    with child.stdout as spoken, child.stderr as complained:
        try:
            complaint = _listen(child.pid, spoken, complained, _Lines(take), look)
        finally:
            kill_session(child.pid)
            child.wait()
    return ChildEnd(child.returncode, complaint.decode(errors="replace"))


def _listen(pid: int, spoken: IO[bytes], complained: IO[bytes], lines: _Lines, look: Callable[[], None]) -> bytes:
    """Read both pipes until they end, or the child has ended and said its last; the end of its complaints."""
    complaint = b""
    next_look = 0.0
    gone_at: float | None = None
    with selectors.DefaultSelector() as ready:
        for pipe in (spoken, complained):
            ready.register(pipe, selectors.EVENT_READ)
        while gone_at is None or time.monotonic() < gone_at:
            heard = False
            for key, _ in ready.select(_LOOK_S):
                data = os.read(key.fd, _PIECE_BYTES)
                heard = heard or bool(data)
                if not data:
                    ready.unregister(key.fileobj)
                elif key.fileobj is spoken:
                    lines.add(data)
                else:
                    complaint = (complaint + data)[-_COMPLAINT_BYTES:]
            now = time.monotonic()
            if now >= next_look:
                look()
                next_look = now + _LOOK_S
            if not heard and has_ended(pid):
                break
            if not ready.get_map():
                if gone_at is None:
                    gone_at = now + _LAST_BREATH_S
                time.sleep(0.01)
    return complaint


class _Lines:
    """Takes pieces of bytes and gives whole lines."""

    def __init__(self, take: Callable[[bytes], None]) -> None:
        self._take = take
        self._rest = bytearray()
        self._count = 0

    def add(self, data: bytes) -> None:
        self._count += len(data)
        first, *others = data.split(b"\n")
        self._rest += first
        for piece in others:
            line, self._rest = bytes(self._rest), bytearray(piece)
            self._take(line)
        if len(self._rest) > _LINE_BYTES or self._count > _SPOKEN_BYTES:
            raise TalksTooMuchError
