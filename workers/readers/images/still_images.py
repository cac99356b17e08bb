"""An encoded image as a frame: as it is where browsers show it faithfully, else as a PNG of 8 bits."""

from __future__ import annotations

from typing import Any, Final

from workers.readers.images.completeness import check_complete
from workers.readers.images.headers import damaged, read_image_header
from workers.readers.recording import Frame

IMAGE_SUFFIXES: Final = frozenset({".jpg", ".jpeg", ".png", ".webp", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".pnm"})
_SHOWN: Final = ("image/jpeg", "image/png", "image/webp")  # by browsers


def image_frame(data: bytes, stamp_ns: int, where: str, encoding: str = "") -> Frame:
    """A frame of an encoded image, whose content tells its format.

    JPEG, WebP and PNG of 8 bits stay byte for byte. PNG of 16 bits, TIFF, BMP and PNM are decoded, and encoded as PNG
    of 8 bits. The mosaic of a Bayer sensor becomes colour.

    Args:
        data: the whole image.
        stamp_ns: of the frame.
        where: names the image in errors.
        encoding: the ROS name of what its pixels are, where that is known.

    Raises:
        MessageError: ``image_empty``, ``image_unsupported``, ``image_damaged``, ``image_too_large``,
            ``image_turned``.
    """
    header = read_image_header(data, where)
    if header.media_type not in _SHOWN or (header.media_type == "image/png" and data[24] == 16):
        return _decoded(data, stamp_ns, where, encoding)
    check_complete(data, header.media_type, where)
    if encoding.lower().startswith("bayer"):
        return _decoded(data, stamp_ns, where, encoding)
    return Frame(stamp_ns, data, header.media_type, header.width, header.height)


def _decoded(data: bytes, stamp_ns: int, where: str, encoding: str) -> Frame:
    import cv2  # only here: most recordings need none of it, and a child starts 60 ms sooner without
    import numpy as np

    from workers.readers.images.transcode import BAYER, STRETCHED, bayer_conversion, png_frame

    try:
        pixels: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise damaged(where, str(error.err or error).splitlines()[0]) from error
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise damaged(where, "its pixels cannot be decoded as 8 or 16 bits")
    conversion = bayer_conversion(encoding)
    if conversion is not None and pixels.ndim == 2:
        convert: Any = cv2.cvtColor
        sentence = f"{BAYER} {STRETCHED}" if pixels.dtype == np.uint16 else BAYER
        return png_frame(convert(pixels, conversion), stamp_ns, where, sentence)
    return png_frame(pixels, stamp_ns, where)
