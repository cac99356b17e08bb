"""A score over offsets of the mount: its curves, and where it peaks, with a standard deviation by the jackknife.

Offsets are small turns about the camera's axes and shifts along them, in the order pitch (about x), yaw (about y),
roll (about z), x, y, z; radians and metres. Pixels move linearly with them: at 2 degrees and 30 degrees off the axis
the rest is below 2 px.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from workers.validation.calibration import KnownCalibration

Floats = NDArray[np.float64]

# Turns that are looked at, degrees: a mount that is off by more shows in any overlay.
_REACH_DEG: Final = 1.5
_STEP_DEG: Final = 0.1
_CURVE_DEG: Final = 2.0
_SHIFT_M: Final = 0.5
_SHIFT_STEP_M: Final = 0.025
# The peak is that of a parabola through the scores around the highest one.
_AROUND_DEG: Final = 0.35
# What lies farther from the peak than this is another place.
_APART_DEG: Final = 1.0
# Largest number of groups of the jackknife, which leaves out one at a time.
MOST_GROUPS: Final = 60

_NAMES: Final = ("pitch", "yaw", "roll", "x", "y", "z")


class ImageParts(NamedTuple):
    """Points of one frame whose pixels are looked up.

    Attributes:
        pixels: (N, 2) where the calibration projects them.
        by_offset: (N, 2, 6) how pixels move with the offsets.
        weights: (N, C) of the image's C channels.
        group: (N,) groups whose errors are independent.
    """

    pixels: Floats
    by_offset: Floats
    weights: Floats
    group: NDArray[np.int64]


class Peak(NamedTuple):
    """The turn of the mount at which the score is highest, degrees; deviations of it; and the score there.

    ``lead`` is how far the score stands above the highest one that is a degree or more away, in deviations of that
    difference. Without it a curve is flat, or has several peaks.
    """

    pitch_deg: float
    yaw_deg: float
    sigma_pitch_deg: float
    sigma_yaw_deg: float
    score: float
    lead: float


def parts_of(calibration: KnownCalibration, points: Floats, group: NDArray[np.int64]) -> ImageParts:
    """Points (N, 3), LiDAR frame, as parts; those that the image does not show are left out."""
    pixels, is_visible = calibration.project(points)
    by_offset = calibration.jacobians(points[is_visible])[0]
    return ImageParts(pixels[is_visible], by_offset, np.ones((int(is_visible.sum()), 1)), group[is_visible])


def turn_grid() -> Floats:
    """(K, 6) offsets: all turns of pitch and yaw within reach."""
    steps = np.arange(-_REACH_DEG, _REACH_DEG + _STEP_DEG / 2, _STEP_DEG)
    pitch, yaw = np.meshgrid(np.radians(steps), np.radians(steps), indexing="ij")
    offsets = np.zeros((pitch.size, 6))
    offsets[:, 0], offsets[:, 1] = pitch.ravel(), yaw.ravel()
    return offsets


def curve_offsets() -> tuple[Floats, list[dict[str, Any]]]:
    """(K, 6) offsets along each axis alone, and what each stretch of them is."""
    rows: list[Floats] = []
    curves: list[dict[str, Any]] = []
    for axis, name in enumerate(_NAMES):
        is_turn = axis < 3
        reach, step = (_CURVE_DEG, _STEP_DEG / 2) if is_turn else (_SHIFT_M, _SHIFT_STEP_M)
        at = np.arange(-reach, reach + step / 2, step)
        along = np.zeros((len(at), 6))
        along[:, axis] = np.radians(at) if is_turn else at
        rows.append(along)
        curves.append({"offset": name, "unit": "deg" if is_turn else "m", "at": np.round(at, 6).tolist()})
    return np.concatenate(rows), curves


@njit(nogil=True, error_model="numpy", cache=True)
def look_up(
    image: NDArray[np.float32] | NDArray[np.uint8],
    scale: float,
    pixels: Floats,
    by_offset: Floats,
    weights: Floats,
    group: NDArray[np.int64],
    offsets: Floats,
    sums: Floats,
    counts: Floats,
) -> None:
    """Add the image's values at moved pixels to sums and counts (K, G), of offsets (K, 6).

    image: (C, h, w), `scale` of whose pixels make one of `pixels`. Pixels outside of the image count nowhere, others
    by the length of their weights.
    """
    channels, height, width = image.shape
    for k in range(offsets.shape[0]):
        for i in range(pixels.shape[0]):
            u, v = pixels[i, 0], pixels[i, 1]
            for j in range(6):
                u += by_offset[i, 0, j] * offsets[k, j]
                v += by_offset[i, 1, j] * offsets[k, j]
            column, row = int(np.floor((u + 0.5) * scale)), int(np.floor((v + 0.5) * scale))
            if 0 <= column < width and 0 <= row < height:
                square = 0.0
                for c in range(channels):
                    sums[k, group[i]] += weights[i, c] * image[c, row, column]
                    square += weights[i, c] * weights[i, c]
                counts[k, group[i]] += np.sqrt(square)


def group_mean(sums: Floats, counts: Floats) -> Floats:
    """(K,) mean value over all groups."""
    return sums.sum(axis=1) / np.maximum(counts.sum(axis=1), 1.0)


def find_peak(offsets: Floats, sums: Floats, counts: Floats) -> Peak | None:
    """The peak over a grid of turns; None where fewer than three groups have anything.

    Deviations are those of the jackknife that leaves out one group at a time (Efron and Stein 1981), around the
    highest score of all groups. The jackknife holds only for estimates that move smoothly with the data, so the peak
    must not jump to another one when a group is left out. ``lead`` says whether another peak is as high.
    """
    there = counts.sum(axis=0) > 0
    if np.count_nonzero(there) < 3:
        return None
    sums, counts = sums[:, there], counts[:, there]
    turns = np.degrees(offsets[:, :2])
    whole_sum, whole_count = sums.sum(axis=1), counts.sum(axis=1)
    score = whole_sum / np.maximum(whole_count, 1.0)
    best = int(score.argmax())
    far = np.hypot(*(turns - turns[best]).T) > _APART_DEG
    without = (whole_sum[:, None] - sums) / np.maximum(whole_count[:, None] - counts, 1.0)
    sigma_pitch, sigma_yaw, _ = jackknife(np.array([_summit(turns, column, best) for column in without.T]))
    leads = without[~far].max(axis=0) - without[far].max(axis=0)
    pitch, yaw, height = _summit(turns, score, best)
    return Peak(
        pitch_deg=float(pitch),
        yaw_deg=float(yaw),
        sigma_pitch_deg=float(sigma_pitch),
        sigma_yaw_deg=float(sigma_yaw),
        score=float(height),
        lead=float((score.max() - score[far].max()) / max(jackknife(leads[:, None])[0], 1e-9)),
    )


def jackknife(values: Floats) -> Floats:
    """Standard deviations (M,) of estimates, from (G, M) estimates without one group each."""
    count = len(values)
    return np.sqrt((count - 1) / count * np.sum((values - values.mean(axis=0)) ** 2, axis=0))


def _summit(turns: Floats, score: Floats, best: int) -> Floats:
    """Pitch, yaw and height of the summit, by a quadratic around the turn ``best``."""
    near = np.hypot(*(turns - turns[best]).T) <= _AROUND_DEG
    p, y = (turns[near] - turns[best]).T
    design = np.column_stack([np.ones_like(p), p, y, p * p, p * y, y * y])
    c = np.linalg.lstsq(design, score[near], rcond=None)[0]
    H = np.array([[2.0 * c[3], c[4]], [c[4], 2.0 * c[5]]])
    if H[0, 0] >= 0.0 or np.linalg.det(H) <= 0.0:
        return np.array([*turns[best], score[best]])
    step = np.clip(-np.linalg.solve(H, c[1:3]), -_AROUND_DEG, _AROUND_DEG)
    return np.array([*(turns[best] + step), c[0] + c[1:3] @ step + 0.5 * step @ H @ step])
