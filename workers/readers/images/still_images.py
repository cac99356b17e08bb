"""An encoded image as a frame: as it is where browsers show it faithfully, else as a PNG of 8 bits."""

from __future__ import annotations

import struct
from typing import Any, Final

from workers.readers.images.headers import DEFLATE_LIMIT, check_size, read_image_header
from workers.readers.recording import Frame, ReadError

IMAGE_SUFFIXES: Final = frozenset({".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".pnm"})
_DECODED: Final = (b"BM", b"P5", b"P6", b"II*\0", b"MM\0*")
_TIFF_SIZE: Final = {3: "H", 4: "I"}


def image_frame(data: bytes, stamp_ns: int, where: str) -> Frame:
    """A frame of an encoded image, whose content tells its format.

    JPEG, WebP and PNG of 8 bits stay byte for byte. PNG of 16 bits, TIFF, BMP and PNM are decoded, and encoded as PNG
    of 8 bits.

    Args:
        data: the whole image.
        stamp_ns: of the frame.
        where: names the image in errors.

    Raises:
        ReadError: ``image_unsupported``, ``image_damaged``, ``image_too_large``, ``image_turned``.
    """
    if data.startswith(_DECODED):
        _check_header(data, where)
    else:
        header = read_image_header(data, where)
        if header.media_type != "image/png" or data[24] != 16:
            return Frame(stamp_ns, data, header.media_type, header.width, header.height)
    return _decoded(data, stamp_ns, where)


def _decoded(data: bytes, stamp_ns: int, where: str) -> Frame:
    import cv2  # only here: most recordings need none of it, and a child starts 60 ms sooner without
    import numpy as np

    from workers.readers.images.transcode import png_frame

    try:
        pixels: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise _damaged(where, str(error.err or error).splitlines()[0]) from error
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise _damaged(where, "its pixels cannot be decoded as 8 or 16 bits")
    return png_frame(pixels, stamp_ns, where)


def _damaged(where: str, why: str) -> ReadError:
    return ReadError("image_damaged", f"{where} is damaged: {why}.", "Leave this image out, or convert it to PNG.")


def _check_header(data: bytes, where: str) -> None:
    """Hold the size that an image claims against the limit, before anything decodes it."""
    try:
        if data[:2] == b"BM":
            width, height = struct.unpack_from("<ii", data, 18)
        elif data[:2] in (b"P5", b"P6"):
            width, height = _pnm_size(data)
        else:
            width, height = _tiff_size(data)
    except (struct.error, ValueError, IndexError):
        raise _damaged(where, "its header is cut short or states no size") from None
    height = abs(height)
    if width <= 0 or height == 0:
        raise _damaged(where, f"its header claims {width} x {height} pixels")
    check_size(width, height, where)
    packs = 1 if data[:1] == b"P" else DEFLATE_LIMIT
    if width * height > packs * len(data):
        raise _damaged(where, f"{len(data)} bytes cannot hold the {width} x {height} pixels that its header claims")


def _pnm_size(data: bytes) -> tuple[int, int]:
    words = [word for line in data[:1024].split(b"\n") for word in line.partition(b"#")[0].split()]
    if not (words[1].isdigit() and words[2].isdigit()):
        raise ValueError
    return int(words[1]), int(words[2])


def _tiff_size(data: bytes) -> tuple[int, int]:
    order = "<" if data[:1] == b"I" else ">"
    (directory,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, directory)
    size: dict[int, int] = {}
    for entry in range(directory + 2, directory + 2 + 12 * count, 12):
        tag, kind = struct.unpack_from(order + "HH", data, entry)
        if tag in (256, 257) and kind in _TIFF_SIZE:
            (size[tag],) = struct.unpack_from(order + _TIFF_SIZE[kind], data, entry + 8)
    return size.get(256, 0), size.get(257, 0)
