"""The strength of an image's gradients against their surroundings, across and along."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

# Of the image's width: what counts as the surroundings of a pixel.
_AROUND: Final = 1 / 16
# Grey levels of a gradient (Sobel's, summed weights of 4) that noise makes in a plain area.
_FLOOR: Final = 8.0


def edge_image(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(2, h, w) float32: gradients across u and across v, smoothed by a pixel, over their mean nearby (1 is usual).

    image: (h, w) grey.
    """
    grey = image.astype(np.float32)
    size = max(3, int(_AROUND * grey.shape[1]))
    maps = np.empty((2, *grey.shape), np.float32)
    for number, (du, dv) in enumerate(((1, 0), (0, 1))):
        strength = np.abs(cv2.Sobel(grey, cv2.CV_32F, du, dv))
        strength = cv2.GaussianBlur(strength, (0, 0), 1.0)
        maps[number] = strength / (cv2.blur(strength, (size, size)) + _FLOOR)
    return maps
