"""Pixels of a road that are brighter than the road beside them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.validation.calibration import KnownCalibration
from workers.validation.lane_markers import BRIGHT, WINDOW_M
from workers.validation.local_excess import local_excess

Floats = NDArray[np.float64]
# Rows around one whose ground points tell how far the road is there.
_ROWS: Final = 12


def bright_pixels(image: NDArray[np.uint8], calibration: KnownCalibration, ground: Floats) -> NDArray[np.uint8]:
    """(h, w) 1 on pixels that are bright against their row, 0 elsewhere and where no ground is.

    A row of the image sees the road at about one range, so a window of metres is one of pixels there. Red and green
    count: yellow paint is dark in blue.

    Args:
        image: (h, w, 3), BGR, possibly smaller than the calibration's.
        calibration: where the ground is in the image; a degree does not matter.
        ground: (M, 3) points of the ground, metres, LiDAR frame.
    """
    height, width = image.shape[:2]
    mask = np.zeros((height, width), np.uint8)
    pixels, is_visible = calibration.project(ground)
    if not is_visible.any():
        return mask
    scale = width / calibration.image_size[0]
    rows = (pixels[is_visible, 1] + 0.5) * scale - 0.5
    depth = calibration.mount.apply(ground[is_visible])[:, 2]
    order = np.argsort(rows)
    rows, depth = rows[order], depth[order]
    grey = image[..., 1:].astype(np.float64).mean(axis=2)
    columns = np.arange(width, dtype=np.float64)
    focal = scale * float(calibration.intrinsics[0])
    ahead = np.nan
    for row in range(max(int(rows[0]), 0), min(int(rows[-1]) + 1, height)):
        first, last = np.searchsorted(rows, (row - _ROWS, row + _ROWS))
        if last > first:
            ahead = float(np.median(depth[first:last]))
        excess = local_excess(columns, grey[row], WINDOW_M * focal / ahead, 1.0)
        mask[row] = excess > BRIGHT
    return mask
