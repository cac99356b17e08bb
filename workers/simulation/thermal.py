"""Frames of a thermal camera: painted in temperatures, blurred by its lens, with its noise, as counts of 16 bits."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from workers.simulation.figure import BOARD_COLOURS, WARMER_K, Colour

_AIR_K: Final = 290.0
_LEVEL_K: Final = 0.1  # of a level of the canvas of 8 bits, which is painted about the air's
_MIDDLE: Final = 128
_COUNT_K: Final = 0.04  # of a count: FLIR Tau 2, TLinear in high resolution
_NETD_K: Final = 0.05  # FLIR states less than 50 mK for the Tau 320 at f/1.0
# A lens of 25 mm and f/1.0 that is focused at 10 m blurs what is 4 m away over f^2 / N (1/4 - 1/10) = 94 um (thin
# lens), a disc of 5.5 pixels of 17 um, which deviates by a quarter of that; one of 14 mm over 1.7 pixels.
_BLUR_PX: Final = (0.5, 1.5)
_CONTRAST_K: Final = (1.0, 4.0)  # assumed: a board from the car or in the sun
_GREY_K: Final = -0.04  # of a grey level of the painted scene: sky and white paint are colder than asphalt
_ASPHALT: Final = 112.0
_LUMINANCE: Final = (0.114, 0.587, 0.299)  # ITU-R BT.601, blue, green, red


class ThermalCamera:
    """The draw of a seed: the board's contrast and the lens' blur.

    Attributes:
        contrast_k: how much warmer than the air the board is; negative if it is colder.
        blur_px: standard deviation.
    """

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng([seed, 12])
        self._seed = seed
        self.contrast_k = float(random.choice([-1.0, 1.0]) * random.uniform(*_CONTRAST_K))
        self.blur_px = float(random.uniform(*_BLUR_PX))

    def background(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Levels of temperature (H, W, 3) of a painted scene (H, W, 3), BGR."""
        grey = image.astype(np.float32) @ np.array(_LUMINANCE, np.float32)
        levels = np.clip(np.rint(_MIDDLE + (grey - _ASPHALT) * (_GREY_K / _LEVEL_K)), 0, 255)
        return np.repeat(levels.astype(np.uint8)[..., None], 3, axis=2)

    def colour(self, colour: Colour) -> Colour:
        """A shape's colour as levels of temperature; transparent where a shadow falls."""
        if colour[3] < 255:
            return 0, 0, 0, 0
        warmer_k = self.contrast_k if colour in BOARD_COLOURS else WARMER_K.get(colour)
        if warmer_k is None:
            warmer_k = (float(np.dot(colour[:3], _LUMINANCE)) - _ASPHALT) * _GREY_K
        level = round(_MIDDLE + warmer_k / _LEVEL_K)
        return level, level, level, 255

    def counts(self, image: NDArray[np.uint8], index: int) -> NDArray[np.uint16]:
        """The frame (H, W) of an index, of levels (H, W, 3)."""
        levels = np.asarray(cv2.GaussianBlur(image[..., 0].astype(np.float32), (0, 0), self.blur_px), np.float64)
        noise = np.random.default_rng([self._seed, 13, index]).normal(0.0, _NETD_K, levels.shape)
        kelvin = _AIR_K + (levels - _MIDDLE) * _LEVEL_K + noise
        return np.clip(np.rint(kelvin / _COUNT_K), 0, 65535).astype(np.uint16)
