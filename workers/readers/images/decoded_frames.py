"""Frames of a recording as pixels, decoded in a child process with limits: they are strangers' bytes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.limited import child_command, child_environment
from workers.readers.limits import Limits
from workers.readers.recording import ReadError
from workers.readers.supervise import supervise

_ROOT: Final = Path(__file__).parents[3]
# A frame of 20 megapixels decodes in 0.5 s.
_LIMITS: Final = Limits(cpu_s=120, wall_s=300.0, file_bytes=512 * 1024**2)
_AT_ONCE: Final = 8


def decoded_frames(
    source: Path,
    places: Sequence[tuple[int, int]],
    scratch: Path,
    *,
    colour: bool,
    widest: int,
    must_stop: Callable[[], None],
    deep: bool = False,
) -> Iterator[NDArray[Any] | None]:
    """The pixels of each frame, in order; None where it cannot be decoded, or is too large.

    Args:
        source: the camera's normalised file.
        places: offset and length of each encoded image in it.
        scratch: a folder for the pixels of a few frames at a time.
        colour: (height, width, 3) BGR, else (height, width) grey.
        widest: images that are wider, or have more pixels than a square of this width, are made smaller by 2, 4 or 8.
        deep: (height, width) uint16 of frames that hold 16 bits, as large as they are.
        must_stop: called several times a second; what it raises ends the child and comes out of here.

    Raises:
        ReadError: ``frames_not_decoded``.
    """
    for first in range(0, len(places), _AT_ONCE):
        some = places[first : first + _AT_ONCE]
        words = ["--widest", str(widest), *(["--colour"] if colour else []), *(["--deep"] if deep else [])]
        _decode(source, some, scratch, words, must_stop)
        for number in range(len(some)):
            file = scratch / f"{number}.npy"
            yield np.load(file, allow_pickle=False) if file.exists() else None
            file.unlink(missing_ok=True)


def _decode(
    source: Path,
    places: Sequence[tuple[int, int]],
    scratch: Path,
    words: Sequence[str],
    must_stop: Callable[[], None],
) -> None:
    limits = {name: getattr(_LIMITS, name) for name in ("memory_bytes", "cpu_s", "file_bytes")}
    frames = ("--frames", json.dumps(list(places)))
    command = child_command("workers.readers.images.decode", source, scratch, limits, *frames, *words)
    began = time.monotonic()

    def look() -> None:
        must_stop()
        if time.monotonic() - began > _LIMITS.wall_s:
            raise _failed("it took too long")

    ended = supervise(command, folder=_ROOT, environment=child_environment(), take=lambda line: None, look=look)
    if ended.code != 0:
        error = _failed(f"its process ended with code {ended.code}")
        error.add_note(ended.complaint)
        raise error


def _failed(why: str) -> ReadError:
    return ReadError(
        "frames_not_decoded",
        f"Frames of the camera could not be decoded: {why}.",
        "A frame may be damaged. Look at the recording's frames in the browser; record or export them again.",
    )
