"""A frame with the points that its camera sees, coloured by their distance."""

from __future__ import annotations

from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.overlays.visible import Visible

_STOPS: Final = 9
# A square's side grows with the image, as in the pages.
_PX_PER_SIDE: Final = 480


class Depths(NamedTuple):
    """Distances that the ends of the palette stand for, metres; what is between them goes by the logarithm."""

    low: float
    high: float


def depths_of(distance: NDArray[np.float32]) -> Depths | None:
    """The distances between which nearly all points lie."""
    if not len(distance):
        return None
    low, high = np.quantile(distance, [0.02, 0.98], method="nearest")
    low = max(0.1, float(low))
    return Depths(low, max(float(high), 1.01 * low))


def draw(image: NDArray[np.uint8], seen: Visible, width: int) -> Depths | None:
    """Draw into an image (H, W, 3) BGR. The nearest points are drawn last.

    Args:
        width: of the frame, px; the image may be a smaller one of it.
    """
    depths = depths_of(seen.distance)
    if depths is None:
        return None
    side = max(2, round(image.shape[1] / _PX_PER_SIDE))
    order = np.argsort(-seen.distance, kind="stable")
    share = np.log(seen.distance[order] / depths.low) / np.log(depths.high / depths.low)
    colours = _colours(np.clip(share, 0.0, 1.0))
    # The centre of the first pixel is half a pixel inside of the image.
    corner = np.rint((seen.pixels[order] + 0.5) * (image.shape[1] / width) - side / 2).astype(np.int64)
    for down in range(side):
        for right in range(side):
            column, row = corner[:, 0] + right, corner[:, 1] + down
            within = (column >= 0) & (row >= 0) & (column < image.shape[1]) & (row < image.shape[0])
            image[row[within], column[within]] = colours[within]
    return depths


def png(image: NDArray[np.uint8]) -> bytes:
    """An image (H, W, 3) BGR as a PNG file."""
    made, data = cv2.imencode(".png", image)
    assert made
    return data.tobytes()


def _colours(share: NDArray[np.floating]) -> NDArray[np.uint8]:
    """(N, 3) BGR of numbers (N,) from 0 to 1: Green's cubehelix (2011) from blue to orange, as the pages have it."""
    stops = np.linspace(0.0, 1.0, _STOPS)
    light = 0.42 + 0.5 * stops
    angle = 2 * np.pi * (1 - 0.55 * stops)
    amplitude = 1.3 * light * (1 - light) / 2
    turns = np.array([[1.97294, 0.0], [-0.29227, -0.90649], [-0.14861, 1.78277]])
    bent = light + amplitude * (turns @ np.array([np.cos(angle), np.sin(angle)]))
    channels = np.clip(bent, 0.0, 1.0)
    return np.column_stack([np.rint(255 * np.interp(share, stops, one)) for one in channels]).astype(np.uint8)
