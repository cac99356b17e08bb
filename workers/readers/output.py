"""Every file that the reading of a recording writes: all its bytes are counted here, and bounded."""

from __future__ import annotations

import io
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final, cast

from workers.readers.progress import beat

# Bytes between two looks at the disk's free space: a tenth of the smallest reserve that makes sense.
_LOOK_BYTES: Final = 4 * 1024**2


class OutputLimitError(Exception):
    """The recording grew past what a recording of its size may write."""


class ReserveError(Exception):
    """The disk has no more than its reserve left."""


@dataclass(slots=True)
class _Written:
    """The bytes that this process has written and may write; without limits until :func:`limit_output`."""

    count: int = 0
    most: int | None = None
    most_with_video: int | None = None
    reserve: int = 0
    unchecked: int = 0


_WRITTEN: Final = _Written()


def limit_output(most: int | None, most_with_video: int | None, reserve: int) -> None:
    """Hold this process to limits, and begin to count.

    Args:
        most: bytes altogether, of all files, also of those that are removed again; None: no limit.
        most_with_video: the same from the moment at which :func:`video_is_decoded` is called.
        reserve: bytes that must stay free on the disk.
    """
    _WRITTEN.count, _WRITTEN.unchecked = 0, _LOOK_BYTES  # the disk is asked before the first byte
    _WRITTEN.most, _WRITTEN.most_with_video, _WRITTEN.reserve = most, most_with_video, reserve


def video_is_decoded() -> None:
    """Let the wider limit hold: a frame of video takes far fewer bytes than the same frame as JPEG."""
    _WRITTEN.most = _WRITTEN.most_with_video


def bytes_written() -> int:
    """Bytes that this process has written since :func:`limit_output`."""
    return _WRITTEN.count


def declare(size: int, disk: int | Path) -> None:
    """Count bytes that are about to be written, so that what is refused is in no buffer either.

    Args:
        disk: a file's descriptor, or a path, on the disk that is written to.

    Raises:
        OutputLimitError, ReserveError.
    """
    beat()
    if _WRITTEN.most is not None and _WRITTEN.count + size > _WRITTEN.most:
        raise OutputLimitError
    _WRITTEN.count += size
    _WRITTEN.unchecked += size
    if _WRITTEN.unchecked >= _LOOK_BYTES and _WRITTEN.reserve:
        _WRITTEN.unchecked = 0
        if shutil.disk_usage(disk).free - size < _WRITTEN.reserve:
            raise ReserveError


def create(path: Path) -> BinaryIO:
    """Open a new file for writing, whose bytes count. Nothing else in this package may write.

    Its ``write`` raises :class:`OutputLimitError` and :class:`ReserveError`.
    """
    return cast(BinaryIO, _Counted(io.FileIO(path, "w")))


class _Counted(io.BufferedWriter):
    def write(self, data: object, /) -> int:
        view = memoryview(cast(bytes, data))
        declare(view.nbytes, self.fileno())
        return super().write(view)
