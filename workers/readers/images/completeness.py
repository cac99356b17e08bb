"""Whether an encoded image is whole, by its structure: to decode every frame would take longer than to read. A JPEG
that looks spoilt is decoded.

Sources: JPEG, ITU-T T.81 annex B; PNG, third edition, 5; WebP, RFC 9649.
"""

from __future__ import annotations

import re
import struct
import zlib
from importlib import import_module
from typing import Any, Final

from workers.readers.images.headers import damaged

# In coded data a byte 0xFF is followed by 0 or a restart marker; fill bytes are 0xFF.
_MARKER: Final = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_START_OF_SCAN, _END_OF_IMAGE = 0xDA, 0xD9
# Between scans of a JPEG stand tables, further scans, comments and a count of lines; in a scan none of these.
_BETWEEN_SCANS: Final = frozenset((0xC4, 0xCC, 0xDA, 0xDB, 0xDC, 0xDD, 0xFE, *range(0xE0, 0xF0)))
_MOST_PARTS: Final = 10_000
_PNG_SIGNATURE: Final = 8
# A file that was written to a full disk, or copied halfway, often keeps its size and ends in zeros; compressed data
# does not.
_ZEROS: Final = bytes(256)


def check_complete(data: bytes, media_type: str, where: str) -> None:
    """Refuse a JPEG, PNG or WebP that is cut short.

    Args:
        data: the whole image, whose header was read.
        where: names the image in errors.

    Raises:
        MessageError: ``image_damaged``.
    """
    if not _CHECKS[media_type](data):
        raise damaged(where, f"its {len(data)} bytes end, or are spoilt, before its last row")


def _jpeg(data: bytes) -> bool:
    scans = _scans(data)
    return (scans is not None and data.find(_ZEROS, *scans) < 0) or is_sound_jpeg(data)


def _scans(data: bytes) -> tuple[int, int] | None:
    """Return where the scans of a JPEG begin and end; None if its markers do not lead to its end in their order."""
    at, start = 2, 0
    for _ in range(_MOST_PARTS):
        marker = _MARKER.search(data, at)
        if marker is None:
            return None
        at, kind = marker.end(), data[marker.end() - 1]
        if kind == _END_OF_IMAGE:
            return start, at
        if kind < 0xC0 or at + 2 > len(data) or (start and kind not in _BETWEEN_SCANS):
            return None
        start = start or (at if kind == _START_OF_SCAN else 0)
        (length,) = struct.unpack_from(">H", data, at)
        at += length
    return None


def is_sound_jpeg(data: bytes) -> bool:
    """Whether every row decodes, and the decoder has nothing to forgive. Some cameras leave out the last marker."""
    if data.endswith(_ZEROS):
        return False
    av: Any = import_module("av")
    context = av.CodecContext.create("mjpeg", "r")
    context.thread_count, context.options = 1, {"err_detect": "explode"}
    try:
        return bool(context.decode(av.Packet(data + bytes((0xFF, _END_OF_IMAGE)))))
    except av.error.FFmpegError:
        return False


def _png(data: bytes) -> bool:
    at, has_pixels = _PNG_SIGNATURE, False
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data):
            return False
        is_critical = not kind[0] & 0x20
        if is_critical and zlib.crc32(memoryview(data)[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end]):
            return False
        has_pixels |= kind == b"IDAT"
        if kind == b"IEND":
            return has_pixels
        at = end
    return False


def _webp(data: bytes) -> bool:
    size = 8 + int.from_bytes(data[4:8], "little")
    return size <= len(data) and not data[:size].endswith(_ZEROS)


_CHECKS: Final = {"image/jpeg": _jpeg, "image/png": _png, "image/webp": _webp}
