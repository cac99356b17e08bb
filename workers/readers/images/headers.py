"""Type and size of an image from its header, before anything decodes it."""

from __future__ import annotations

import struct
import warnings
from dataclasses import dataclass
from io import BytesIO
from typing import Final

from PIL import Image

from workers.readers.recording import MessageError

MAX_PIXELS: Final = 200_000_000
# What a file of each format begins with.
_HEADS: Final = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    b"\xff\xd8\xff": "JPEG",
    b"RIFF": "WEBP",
    b"BM": "BMP",
    **dict.fromkeys((b"P5", b"P6"), "PPM"),
    **dict.fromkeys((b"II*\0", b"MM\0*"), "TIFF"),
}
# Pixels that a byte can hold: deflate packs at most 1032 bytes into one.
_EXPANSION: Final = {"PPM": 1, "PNG": 1032, "TIFF": 1032, "BMP": 1032}
_ORIENTATION: Final = 0x112
_BROKEN: Final = (OSError, ValueError, SyntaxError, TypeError, LookupError, OverflowError, EOFError, struct.error)
Image.MAX_IMAGE_PIXELS = None  # `check_size` has the limit


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """The header of an encoded image.

    Attributes:
        media_type: for example ``image/jpeg``.
        width, height: pixels as stored, before any EXIF rotation.
    """

    media_type: str
    width: int
    height: int


def read_image_header(data: bytes, where: str) -> ImageHeader:
    """Type and size of a JPEG, PNG, WebP, TIFF, BMP or PNM image.

    Args:
        data: the whole encoded image.
        where: names the image in error messages.

    Raises:
        MessageError: ``image_empty``, ``image_unsupported`` (another format), ``image_damaged`` (header cut short or
            contradicting the data), ``image_too_large`` (more than :data:`MAX_PIXELS`), ``image_turned`` (Exif
            orientation).
    """
    if not data:
        raise MessageError("image_empty", f"{where} holds no bytes.", "Leave it out, or record it again.")
    form = next((form for head, form in _HEADS.items() if data.startswith(head)), None)
    if form is None:
        raise MessageError(
            "image_unsupported",
            f"{where} is not a JPEG, PNG or WebP image (it starts with {data[:8].hex(' ') or 'nothing'}).",
            "Record or convert the camera's frames to JPEG or PNG.",
        )
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(BytesIO(data), formats=[form]) as image:
            width, height = image.size
            turn = _turn(image) if form == "JPEG" else 1
    except _BROKEN as error:
        raise damaged(where, f"its header is cut short or contradicts itself ({len(data)} bytes)") from error
    check_size(width, height, where)
    if width * height > _EXPANSION.get(form, MAX_PIXELS) * len(data):
        raise damaged(where, f"{len(data)} bytes cannot hold the {width} x {height} pixels that its header claims")
    if turn in range(2, 9):  # a mark on what a person sees would be another pixel than the camera's
        raise MessageError(
            "image_turned",
            f"{where} carries an Exif orientation ({turn}): viewers turn it, calibration would not.",
            "Remove the tag from all frames, for example with `exiftool -Orientation= -r FOLDER`.",
        )
    return ImageHeader(f"image/{form.lower()}", width, height)


def _turn(image: Image.Image) -> object:
    try:
        return image.getexif().get(_ORIENTATION)
    except _BROKEN:
        return 1  # broken Exif turns nothing


def check_size(width: int, height: int, where: str) -> None:
    """Refuse an image that claims more pixels than any camera has.

    Raises:
        MessageError: ``image_too_large``.
    """
    if width * height > MAX_PIXELS:
        raise MessageError(
            "image_too_large",
            f"{where} claims {width} x {height} pixels; at most {MAX_PIXELS // 1_000_000} megapixels are read.",
            "If the camera really is this large, scale its frames down; else the file is damaged.",
        )


def damaged(where: str, why: str) -> MessageError:
    """The refusal of an image."""
    return MessageError("image_damaged", f"{where} is damaged: {why}.", "Leave this image out, or record it again.")
