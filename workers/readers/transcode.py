"""Raw camera frames into PNG."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.readers.images import check_size
from workers.readers.recording import Frame, ReadError

# encoding: (channels stored, OpenCV conversion to BGR, or None where the pixels already are)
_ENCODINGS: Final[dict[str, tuple[int, int | None]]] = {
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "mono8": (1, None),
    "8UC1": (1, None),
}


def raw_to_png(
    pixels: NDArray[np.uint8], *, width: int, height: int, step: int, encoding: str, stamp_ns: int, where: str
) -> Frame:
    """A raw image (``sensor_msgs/Image``) as a PNG frame.

    PNG and not JPEG, because it is lossless: a vertex is marked to a fraction of a pixel, and JPEG's ringing along
    the board's edge would be ours, not the camera's.

    Args:
        pixels: (step * height,) uint8, or longer.
        step: bytes from one row to the next.
        encoding: the ROS name of the pixel format.
        where: names the image in error messages.

    Raises:
        ReadError: ``image_encoding_unsupported``, ``image_damaged``, ``image_too_large``.
    """
    if encoding not in _ENCODINGS:
        raise ReadError(
            "image_encoding_unsupported",
            f"{where} has the pixel format {encoding!r}, which is not read yet.",
            f"Record compressed images, or convert to one of {', '.join(_ENCODINGS)}.",
        )
    channels, conversion = _ENCODINGS[encoding]
    check_size(width, height, where)
    if width == 0 or height == 0 or step < width * channels or len(pixels) < step * height:
        raise ReadError(
            "image_damaged",
            f"{where} is damaged: {len(pixels)} bytes, {step} per row, are no {width} x {height} {encoding}.",
            "Record it again; look at the driver that fills in step, width and height.",
        )
    rows = pixels[: step * height].reshape(height, step)[:, : width * channels]
    image = np.ascontiguousarray(rows).reshape(height, width, channels)
    if conversion is not None:
        image = cv2.cvtColor(image, conversion)
    done, encoded = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise ReadError("image_damaged", f"{where} could not be encoded as PNG.", "Record it again.")
    return Frame(stamp_ns, encoded.tobytes(), "image/png", width, height, transcoded=True)
