"""The child that decodes frames: ``python -m workers.readers.images.decode FILE OUT --frames JSON``.

Writes frame number i as ``OUT/i.npy``, uint8, (height, width, 3) BGR or (height, width) grey; with ``--deep`` uint16
of frames that hold 16 bits.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from workers.readers.confine import add_child_options, confine
from workers.readers.images.deep_images import depth_of
from workers.readers.images.headers import read_image_header
from workers.readers.isolation.isolate import isolate

_REDUCED: Final = {
    (False, 1): cv2.IMREAD_GRAYSCALE,
    (False, 2): cv2.IMREAD_REDUCED_GRAYSCALE_2,
    (False, 4): cv2.IMREAD_REDUCED_GRAYSCALE_4,
    (False, 8): cv2.IMREAD_REDUCED_GRAYSCALE_8,
    (True, 1): cv2.IMREAD_COLOR,
    (True, 2): cv2.IMREAD_REDUCED_COLOR_2,
    (True, 4): cv2.IMREAD_REDUCED_COLOR_4,
    (True, 8): cv2.IMREAD_REDUCED_COLOR_8,
}


def reduced(width: int, height: int, widest: int) -> int | None:
    """Return the factor 1, 2, 4 or 8 that makes an image about as narrow as is needed.

    Then it has no more pixels than a square that is ``widest`` wide. None if it has more even at an eighth.
    """
    return next(
        (
            factor
            for factor in (1, 2, 4, 8)
            if (width <= factor * widest or factor == 8) and width * height <= (factor * widest) ** 2
        ),
        None,
    )


def decoded(data: bytes, *, colour: bool, widest: int) -> Any:
    """The pixels of an encoded image, made smaller by 2, 4 or 8 if it is wider than ``widest`` or has many rows.

    None if it is damaged, or too large for that. A JPEG is decoded at the smaller size, which takes a fraction of the
    time. A rotation that the file states is not applied: calibrations are of the pixels as they lie in the file.
    """
    header = read_image_header(data, "the frame")
    factor = reduced(header.width, header.height, widest)
    if factor is None:
        return None
    flags = _REDUCED[colour, factor] | cv2.IMREAD_IGNORE_ORIENTATION
    return cv2.imdecode(np.frombuffer(data, np.uint8), flags)


def main(argv: Sequence[str] | None = None) -> int:
    """Decode the frames; one that cannot be decoded has no file."""
    parser = argparse.ArgumentParser(prog="python -m workers.readers.images.decode", description=__doc__)
    parser.add_argument("source", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--frames", type=json.loads, required=True, help="JSON: [[offset, length], ...]")
    parser.add_argument("--colour", action="store_true")
    parser.add_argument("--deep", action="store_true")
    parser.add_argument("--widest", type=int, required=True)
    add_child_options(parser)
    arguments = parser.parse_args(argv)
    confine(arguments.parent, arguments.limits)
    cv2.setNumThreads(1)
    if arguments.parent is not None:
        isolate([arguments.source], [arguments.out])
    with arguments.source.open("rb") as file:
        for number, (offset, length) in enumerate(arguments.frames):
            file.seek(offset)
            data = file.read(length)
            pixels = depth_of(data) if arguments.deep else None
            if pixels is None:
                pixels = decoded(data, colour=arguments.colour, widest=arguments.widest)
            if pixels is not None:
                np.save(arguments.out / f"{number}.npy", pixels)
            print(json.dumps({"frame": number}), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
