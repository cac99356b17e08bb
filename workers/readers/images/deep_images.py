"""Grey frames of 16 bits: 8 bits that people see, and beside them in the same PNG what the camera measured.

A private, ancillary chunk (PNG, third edition, 5.4) holds the 16 bits, a PNG of its own. Browsers pass over it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.readers.images.headers import read_image_header
from workers.readers.recording import ReadError

_CHUNK: Final = b"apXd"
_SIGNATURE: Final = 8
_FRAME: Final = 12  # length, type and checksum of a chunk
_SHARE: Final = 0.001
_WINDOW: Final = 0.25  # of the width: boards are marked from 20 px to a fifth of it
_MIDDLE: Final = 128.0
_LEVELS: Final = 50.0  # of one deviation: 2.5 of them fill 8 bits
_OF_NOISE: Final = 10.0  # noise then takes at most five levels
_LAPLACIAN: Final = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)


def with_depth(shown: bytes, image: NDArray[np.uint16]) -> bytes:
    """Return the PNG with the image (H, W) that it shows in 16 bits beside it."""
    _, deep = cv2.imencode(".png", image)
    data = deep.tobytes()
    chunk = struct.pack(">I", len(data)) + _CHUNK + data + struct.pack(">I", zlib.crc32(_CHUNK + data))
    end = len(shown) - _FRAME  # IEND holds nothing
    return shown[:end] + chunk + shown[end:]


def depth_of(encoded: bytes) -> NDArray[np.uint16] | None:
    """Return the 16 bits (H, W) beside an encoded image; None if there are none of its size."""
    deep = next((encoded[start:end] for kind, start, end in _chunks(encoded) if kind == _CHUNK), None)
    if deep is None:
        return None
    try:
        outer, inner = (read_image_header(data, "the frame") for data in (encoded, deep))
    except ReadError:
        return None
    if (outer.width, outer.height) != (inner.width, inner.height):
        return None
    image: Any = cv2.imdecode(np.frombuffer(deep, np.uint8), cv2.IMREAD_UNCHANGED)
    return image if image is not None and image.dtype == np.uint16 and image.ndim == 2 else None


def _chunks(encoded: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Type, begin and end of the data of each chunk of a PNG."""
    at = _SIGNATURE if encoded.startswith(b"\x89PNG") else len(encoded)
    while at + _FRAME <= len(encoded):
        (length,) = struct.unpack_from(">I", encoded, at)
        yield encoded[at + 4 : at + 8], at + 8, at + 8 + length
        at += _FRAME + length


def shown_levels(image: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return 8 bits that show a frame (H, W) of 16, each part by its own mean and deviation.

    This is local contrast normalisation (Peli 1990): a board 2 K off shows beside an engine, and sky. Parts that hold
    nothing but noise stay grey.
    """
    levels = image.astype(np.float32)
    side = max(int(_WINDOW * image.shape[1]), 3)
    away = levels - cv2.blur(levels, (side, side))
    laplacian = cv2.filter2D(levels, -1, _LAPLACIAN)
    noise = float(np.median(np.abs(laplacian))) / 0.6745 / 6.0  # Immerkaer 1996
    deviation = np.sqrt(cv2.blur(away**2, (side, side)) + (_OF_NOISE * max(noise, 0.3)) ** 2)
    return np.clip(np.rint(_MIDDLE + _LEVELS * away / deviation), 0, 255).astype(np.uint8)


def spanned(image: NDArray[np.uint16]) -> tuple[int, int]:
    """Return the values below which a thousandth of an image's values lie, and above which; they differ."""
    counts: NDArray[np.int64] = np.cumsum(np.bincount(image.reshape(-1), minlength=65536))
    total = int(counts[-1])
    low = int(np.searchsorted(counts, _SHARE * total, side="right"))
    return low, max(low + 1, int(np.searchsorted(counts, (1 - _SHARE) * total)))
