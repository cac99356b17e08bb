"""Type and size of an image from its header, before anything decodes it."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from workers.readers.recording import ReadError

MAX_PIXELS: Final = 200_000_000
_PNG: Final = b"\x89PNG\r\n\x1a\n"
_PNG_CHANNELS: Final = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
# Deflate cannot pack more than 1032 bytes into one.
DEFLATE_LIMIT: Final = 1032
# JPEG markers that start a frame and so carry the size: SOF0 to SOF15 without DHT, JPG and DAC.
_JPEG_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_BARE: Final = frozenset({0x01, *range(0xD0, 0xD9)})


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """What an encoded image says of itself.

    Attributes:
        media_type: ``image/jpeg``, ``image/png`` or ``image/webp``.
        width, height: pixels as stored, before any EXIF rotation.
    """

    media_type: str
    width: int
    height: int


def read_image_header(data: bytes | memoryview, where: str) -> ImageHeader:
    """Type and size of a JPEG, PNG or WebP image.

    Args:
        data: the whole encoded image.
        where: names the image in error messages.

    Raises:
        ReadError: ``image_unsupported`` (another format), ``image_damaged`` (header cut short or contradicting
            the data), ``image_too_large`` (more than :data:`MAX_PIXELS`), ``image_turned`` (Exif orientation).
    """
    head = bytes(data[:32])
    try:
        if head.startswith(_PNG):
            header = _png(head, len(data), where)
        elif head.startswith(b"\xff\xd8\xff"):
            header = _jpeg(data, where)
        elif head[:4] == b"RIFF" and head[8:12] == b"WEBP":
            header = _webp(head)
        else:
            raise ReadError(
                "image_unsupported",
                f"{where} is not a JPEG, PNG or WebP image (it starts with {head[:8].hex(' ') or 'nothing'}).",
                "Record or convert the camera's frames to JPEG or PNG.",
            )
    except struct.error:
        raise _damaged(where, f"its header is cut short; it has only {len(data)} bytes") from None
    if header.width == 0 or header.height == 0:
        raise _damaged(where, f"its header claims {header.width} x {header.height} pixels")
    check_size(header.width, header.height, where)
    if head.startswith(_PNG):
        _check_png_data(head, len(data), where)
    return header


def check_size(width: int, height: int, where: str) -> None:
    """Refuse an image that claims more pixels than any camera has.

    Raises:
        ReadError: ``image_too_large``.
    """
    if width * height > MAX_PIXELS:
        raise ReadError(
            "image_too_large",
            f"{where} claims {width} x {height} pixels; at most {MAX_PIXELS // 1_000_000} megapixels are read.",
            "If the camera really is this large, scale its frames down; else the file is damaged.",
        )


def _damaged(where: str, why: str) -> ReadError:
    return ReadError("image_damaged", f"{where} is damaged: {why}.", "Leave this image out, or record it again.")


def _png(head: bytes, size: int, where: str) -> ImageHeader:
    if head[12:16] != b"IHDR":
        raise _damaged(where, f"a PNG begins with an IHDR chunk; this one has {size} bytes and no such chunk")
    width, height = struct.unpack_from(">II", head, 16)
    return ImageHeader("image/png", width, height)


def _check_png_data(head: bytes, size: int, where: str) -> None:
    if len(head) < 26:
        raise _damaged(where, f"it ends after {size} bytes, inside its header")
    width, height, depth, colour = struct.unpack_from(">IIBB", head, 16)
    if colour not in _PNG_CHANNELS or depth not in (1, 2, 4, 8, 16):
        raise _damaged(where, f"its header names no PNG pixel format (depth {depth}, colour type {colour})")
    raw = height * (width * _PNG_CHANNELS[colour] * depth // 8)
    if raw > size * DEFLATE_LIMIT:
        raise _damaged(where, f"{size} bytes cannot hold the {width} x {height} pixels that its header claims")


def _jpeg(data: bytes | memoryview, where: str) -> ImageHeader:
    offset = 2
    while offset + 4 <= len(data):
        if data[offset] != 0xFF:
            raise _damaged(where, f"there is no JPEG marker at byte {offset}")
        marker = data[offset + 1]
        if marker == 0xFF:  # fill byte
            offset += 1
        elif marker in _JPEG_BARE:
            offset += 2
        elif marker in _JPEG_FRAMES:
            height, width = struct.unpack_from(">HH", data, offset + 5)
            return ImageHeader("image/jpeg", width, height)
        elif marker in (0xD9, 0xDA):
            break
        else:
            (length,) = struct.unpack_from(">H", data, offset + 2)
            if marker == 0xE1:
                _check_upright(bytes(data[offset + 4 : offset + 2 + length]), where)
            offset += 2 + length
    raise _damaged(where, "no JPEG frame header comes before its data or its end")


def _check_upright(segment: bytes, where: str) -> None:
    """Refuse a JPEG that viewers turn: a mark on what a person sees would be another pixel than the camera's.

    Args:
        segment: content of an APP1 segment; Exif is a TIFF directory, whose tag 0x112 is the orientation, 1 upright.
    """
    if segment[:6] != b"Exif\0\0" or segment[6:8] not in (b"II", b"MM"):
        return
    order = "<" if segment[6:8] == b"II" else ">"
    try:
        (directory,) = struct.unpack_from(order + "I", segment, 10)
        (count,) = struct.unpack_from(order + "H", segment, 6 + directory)
        for entry in range(8 + directory, 8 + directory + 12 * count, 12):
            tag, _, _, value = struct.unpack_from(order + "HHIH", segment, entry)
            if tag == 0x112 and value in range(2, 9):
                raise ReadError(
                    "image_turned",
                    f"{where} carries an Exif orientation ({value}): viewers turn it, calibration would not.",
                    "Remove the tag from all frames, for example with `exiftool -Orientation= -r FOLDER`.",
                )
    except struct.error:
        return  # broken Exif turns nothing


def _webp(head: bytes) -> ImageHeader:
    kind = head[12:16]
    if kind == b"VP8X":
        width = int.from_bytes(head[24:27], "little") + 1
        height = int.from_bytes(head[27:30], "little") + 1
        if len(head) < 30:
            raise struct.error
    elif kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", head, 21)
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    else:
        width, height = (v & 0x3FFF for v in struct.unpack_from("<HH", head, 26))
    return ImageHeader("image/webp", width, height)
