"""Raw camera frames into PNG of 8 bits a channel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.readers.images.deep_images import shown_levels, spanned, with_depth
from workers.readers.images.headers import check_size
from workers.readers.recording import Frame, MessageError
from workers.readers.ros.topic_messages import RawImage

LOSSLESS: Final = "Raw frames were encoded as PNG, without loss."
STRETCHED: Final = (
    "Frames of 16 bits were stretched to 8, each so that its darkest and its brightest thousandth of pixels become "
    "black and white, and encoded as PNG."
)
_STRETCHED_LOCALLY: Final = (
    "Grey frames of 16 bits were stretched to 8 part by part, so that faint things show, and encoded as PNG. The 16 "
    "bits lie beside them for the machine's marks."
)
BAYER: Final = "Bayer frames were demosaiced (edge-aware) and encoded as PNG."
_YUV: Final = "YUV frames were converted to RGB and encoded as PNG."
# On a photograph of 2.3 megapixels 75 ms and 4.1 MB, where OpenCV's own choice takes 145 ms for 4.0 MB.
_PNG: Final = (
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
)

Layout = Literal["pixels", "pairs", "planes"]
Pixels = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class _Encoding:
    """The layout of a raw image in memory.

    Attributes:
        depth: bytes of one value.
        channels: values of one pixel as stored.
        conversion: OpenCV's code to BGR, or None where the pixels already are.
        sentence: what was done, for the owner.
        layout: ``pixels`` on their own; ``pairs`` that share a colour (an even width); ``planes`` of brightness and
            below it colour at half the resolution (even width and height).
    """

    depth: int
    channels: int
    conversion: int | None
    sentence: str = LOSSLESS
    layout: Layout = "pixels"


def _encodings() -> dict[str, _Encoding]:
    encodings = {
        "mono8": _Encoding(1, 1, None),
        "rgb8": _Encoding(1, 3, cv2.COLOR_RGB2BGR),
        "bgr8": _Encoding(1, 3, None),
        "rgba8": _Encoding(1, 4, cv2.COLOR_RGBA2BGR),
        "bgra8": _Encoding(1, 4, cv2.COLOR_BGRA2BGR),
        "yuv422": _Encoding(1, 2, cv2.COLOR_YUV2BGR_UYVY, _YUV, "pairs"),
        "yuyv": _Encoding(1, 2, cv2.COLOR_YUV2BGR_YUY2, _YUV, "pairs"),
        "nv12": _Encoding(1, 1, cv2.COLOR_YUV2BGR_NV12, _YUV, "planes"),
        "nv21": _Encoding(1, 1, cv2.COLOR_YUV2BGR_NV21, _YUV, "planes"),
    }
    for name in ("mono", "rgb", "bgr", "rgba", "bgra"):
        encodings[f"{name}16"] = _Encoding(
            2, encodings[f"{name}8"].channels, encodings[f"{name}8"].conversion, STRETCHED
        )
    # OpenCV's older names for these count from the second pixel of the second row.
    bayer = {
        "rggb": cv2.COLOR_BayerRGGB2BGR_EA,
        "bggr": cv2.COLOR_BayerBGGR2BGR_EA,
        "gbrg": cv2.COLOR_BayerGBRG2BGR_EA,
        "grbg": cv2.COLOR_BayerGRBG2BGR_EA,
    }
    for pattern, conversion in bayer.items():
        encodings[f"bayer_{pattern}8"] = _Encoding(1, 1, conversion, BAYER)
        encodings[f"bayer_{pattern}16"] = _Encoding(2, 1, conversion, f"{BAYER} {STRETCHED}")
        for bits in (8, 16):  # GenICam's BayerRG8
            encodings[f"bayer{pattern[:2]}{bits}"] = encodings[f"bayer_{pattern}{bits}"]
    others = {
        "8UC1": "mono8",
        "8UC3": "bgr8",
        "8UC4": "bgra8",
        "16UC1": "mono16",
        "16UC3": "bgr16",
        "16UC4": "bgra16",
    }
    others |= {"uyvy": "yuv422", "yuv422_yuy2": "yuyv", "yuy2": "yuyv"}
    return encodings | {alias: encodings[name] for alias, name in others.items()}


_ENCODINGS: Final = _encodings()


def raw_to_png(raw: RawImage, stamp_ns: int, where: str) -> Frame:
    """A raw image as a PNG frame.

    PNG and not JPEG, because it is lossless: a vertex is marked to a fraction of a pixel, and JPEG's ringing along
    the board's edge would be ours, not the camera's.

    Args:
        raw: its data may be longer than its rows. YUV planes have half as many rows again below the first plane.
        stamp_ns: of the frame.
        where: names the image in error messages.

    Raises:
        MessageError: ``image_empty``, ``image_encoding_unsupported``, ``image_damaged``, ``image_too_large``.
    """
    pixels, width, height, step, encoding = raw.data, raw.width, raw.height, raw.step, raw.encoding
    how = _ENCODINGS.get(encoding) or _ENCODINGS.get(encoding.lower())
    if how is None:
        raise MessageError(
            "image_encoding_unsupported",
            f"{where} has the pixel format {encoding[:40]!r}, which is not read.",
            f"Record compressed images, or convert to one of {', '.join(_ENCODINGS)}.",
        )
    check_size(width, height, where)
    if width == 0 or height == 0 or len(pixels) == 0:
        message = f"{where} is empty: {width} x {height} pixels, {len(pixels)} bytes."
        raise MessageError("image_empty", message, "Look at the camera's driver.")
    rows = height + height // 2 if how.layout == "planes" else height
    row_bytes = width * how.channels * how.depth
    odd = (how.layout != "pixels" and width % 2 == 1) or (how.layout == "planes" and height % 2 == 1)
    step = step or row_bytes  # some drivers leave it at 0
    if step < row_bytes or len(pixels) < step * rows or odd:
        raise MessageError(
            "image_damaged",
            f"{where} is damaged: {len(pixels)} bytes, {step} per row, are no {width} x {height} {encoding[:40]}.",
            "Record it again; look at the driver that fills in step, width and height.",
        )
    stored: Any = np.ascontiguousarray(pixels[: step * rows].reshape(rows, step)[:, :row_bytes])
    if how.depth == 2:
        stored = stored.view(">u2" if raw.big_endian else "<u2").astype(np.uint16)
    image: Any = stored.reshape(rows, width, how.channels)
    try:
        return png_frame(_bgr(image, how.conversion), stamp_ns, where, how.sentence)
    except cv2.error as error:
        raise MessageError(
            "image_damaged",
            f"{where} cannot be converted from {encoding}: {str(error.err or error).splitlines()[0]}.",
            "Record it again, or as compressed images.",
        ) from error


def bayer_conversion(encoding: str) -> int | None:
    """OpenCV's code from the mosaic of this name to BGR; None for a name that is of no mosaic."""
    name = encoding.lower()
    return _ENCODINGS[name].conversion if name.startswith("bayer") and name in _ENCODINGS else None


def _bgr(image: Pixels, conversion: int | None) -> Any:
    return image if conversion is None else cv2.cvtColor(image, conversion)


def png_frame(image: Pixels, stamp_ns: int, where: str, sentence: str | None = None) -> Frame:
    """An image as a PNG frame of 8 bits a channel.

    Args:
        image: (H, W), (H, W, 1), (H, W, 3) or (H, W, 4) uint8 or uint16 in the order blue, green, red.
        sentence: what was done to it, for the owner; None: what this function does.

    Raises:
        MessageError: ``image_damaged``.
    """
    if sentence is None:
        sentence = STRETCHED if image.dtype == np.uint16 else "Frames were encoded anew as PNG, without loss."
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[..., 0]
    deep = image.astype(np.uint16, copy=False) if image.dtype == np.uint16 and image.ndim == 2 else None
    if deep is not None:
        image, sentence = shown_levels(deep), _STRETCHED_LOCALLY
    elif image.dtype == np.uint16:
        image = _stretched(image.astype(np.uint16, copy=False))
    if image.ndim == 3 and image.shape[2] == 4:
        image = image[..., :3]
    done, encoded = cv2.imencode(".png", np.ascontiguousarray(image), _PNG)
    if not done:
        raise MessageError("image_damaged", f"{where} could not be encoded as PNG.", "Record it again.")
    height, width = image.shape[:2]
    data = encoded.tobytes() if deep is None else with_depth(encoded.tobytes(), deep)
    return Frame(stamp_ns, data, "image/png", width, height, sentence)


def _stretched(image: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Return a colour frame scaled to 8 bits by its own range: 12-bit cameras fill a small part of 16 bits."""
    low, high = spanned(image[..., :3])
    levels = np.clip((np.arange(65536) - low) * (255 / (high - low)), 0, 255)
    table: NDArray[np.uint8] = np.rint(levels).astype(np.uint8)
    return table[image]
