"""Lane markers of a drive compared with its frames: the score, its curves, and where it would be highest.

The score is the share of the markers' points that lie on bright pixels; `chance` is the share of other ground points
that do. The idea, markers of the lowest rings by their intensity drawn into frames of a drive, is the paper's.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.validation.bright_paint import bright_pixels
from workers.validation.calibration import KnownCalibration
from workers.validation.lane_markers import lane_markers
from workers.validation.motion import STANDING, Motion
from workers.validation.offsets import MOST_GROUPS, curve_offsets, find_peak, group_mean, look_up, parts_of, turn_grid
from workers.validation.road_verdict import ScoredDrive, judge

Floats = NDArray[np.float64]
_ONE_DEGREE: Final = np.radians([[0.0, 1.0, 0, 0, 0, 0], [0.0, -1.0, 0, 0, 0, 0]])


class LaneCheck:
    """Collects frames one by one; `result` says what they show together."""

    widest_px: Final = 2048
    """Frames that are wider are made smaller: paint is some pixels wide there at 30 m."""

    def __init__(self, calibration: KnownCalibration) -> None:
        self.calibration = calibration
        self._turns = turn_grid()
        along, self._curves = curve_offsets()
        self._offsets = np.concatenate([self._turns, along, np.zeros((1, 6)), _ONE_DEGREE])
        self._sums = np.zeros((len(self._offsets), MOST_GROUPS))
        self._counts = np.zeros_like(self._sums)
        self._plain = np.zeros((1, 1)), np.zeros((1, 1))
        self._frames = self._markers = self._points = 0

    def add(self, sweep: Sweep, image: NDArray[np.uint8], motion: Motion = STANDING) -> None:
        """A sweep and the frame (h, w, 3) BGR of its moment, possibly made smaller, and how the LiDAR moves."""
        self._frames += 1
        markers = lane_markers(motion.moved(sweep))
        if markers.ground is None or not markers.total:
            return
        ground = np.concatenate([markers.points, markers.plain])
        paint = bright_pixels(image, self.calibration, ground)[None].astype(np.float32)
        # Markers take turns among the groups, so each group has some of every frame.
        marked = parts_of(self.calibration, markers.points, (markers.marker + self._markers) % MOST_GROUPS)
        self._markers += len(np.unique(marked.group))
        self._points += len(marked.pixels)
        scale = image.shape[1] / self.calibration.image_size[0]
        look_up(paint, scale, *marked, self._offsets, self._sums, self._counts)
        plain = parts_of(self.calibration, markers.plain, np.zeros(len(markers.plain), np.int64))
        look_up(paint, scale, *plain, np.zeros((1, 6)), *self._plain)

    def result(self) -> dict[str, Any]:
        """Return the document of a road score."""
        turns = slice(0, len(self._turns))
        score = group_mean(self._sums, self._counts)
        peak = find_peak(self._turns, self._sums[turns], self._counts[turns])
        start = len(self._turns)
        for curve in self._curves:
            curve["score"] = np.round(score[start : start + len(curve["at"])], 4).tolist()
            start += len(curve["at"])
        at_zero, at_one = float(score[start]), float(score[start + 1 : start + 3].max())
        watched = ScoredDrive("lane markers", self._frames, self._markers, self._points, at_zero, at_one, peak)
        return judge(watched) | {"chance": float(group_mean(*self._plain)[0]), "curves": self._curves}
