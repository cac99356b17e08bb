"""Seeds: where the board may be in a frame, told by what differs from the still background alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from apexcal.documents.corners import CornerName
from workers.marks.sights import Floats, FrameSource, Image

MOST_FRAMES: Final = 64
"""Of the median: a walker covers a pixel in a few of them only, and 64 frames are decoded in two seconds."""
_WIDE_PX: Final = 960  # frames are reduced to this: a seed is good to 15 px of a full one
_SMOOTH_PX: Final = 1.5
_SHAKE_PX: Final = (
    1.0  # of the camera against its background, reduced pixels: edges of the background may differ so much
)
_NOISES: Final = 6.0  # standard deviations of the smoothed difference; a frame of 960 x 540 has 5e5 pixels
_LEAST_SHARE: Final = 3e-4  # of the frame: 12 x 12 px of 960 x 540, a board of 20 px a side with its rim
_CLOSE_PX: Final = 7
_APART: Final = 0.008  # corners nearer to each other than this share of the width are one seed
_HIGHEST: Final = 3
_UPWARD: Final = np.radians([45.0, 25.0, 65.0])  # to upper corners of level boards, which people roll by up to 20
_MOST_BLOBS: Final = 2
_RIVAL_BLOB: Final = 0.5  # of the largest blob's area: a person with a board and one without differ by less
MOST_SEEDS: Final = _HIGHEST * _MOST_BLOBS
_SAMPLES: Final = 5_000  # pixels that match the gain
_GAIN_ROUNDS: Final = 5

Single = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class FrameSeeds:
    """Seeds (K, 2) px of a frame by the corner that they may be; a frame without a blob has none.

    Attributes:
        gain: brightness against the middle frame.
        rivals: how many other blobs are at least half as large as the largest.
    """

    frame: int
    pixels: dict[CornerName, Floats]
    gain: float = 1.0
    rivals: int = 0


def spread_over(frames: Sequence[int], most: int = MOST_FRAMES) -> list[int]:
    """Return at most ``most`` of the frames, at even steps."""
    ordered = sorted(set(frames))
    if len(ordered) <= most:
        return ordered
    return [ordered[k] for k in np.linspace(0, len(ordered) - 1, most).round().astype(int).tolist()]


def find_seeds(frames: FrameSource, chosen: Sequence[int], upper_corner: int = 0) -> list[FrameSeeds]:
    """Seeds of the chosen frames.

    The background is the median of the frames after their gains were matched. In what differs from it the largest
    blob is taken, and a second one of its size: a second person. The three highest corners of a blob's hull may be
    the tip (a head may be above it). The ends of its width may be the board's side corners: boards are wider than
    the people who hold them. Of a board with level edges the hull's corners to the upper left and right are seeds.

    Args:
        upper_corner: which one ``top`` is if the board's edges are level (`apexcal.documents.corners`): 1 the left,
            -1 the right one. 0: a corner is up.
    """
    if not chosen:
        return []
    images = [reduced(frames[index]) for index in chosen]
    shrink = images[0][1]
    reference = images[len(images) // 2][0].astype(np.float32)
    matched: list[Image] = []
    gains: list[float] = []
    for image, _ in images:
        gain, offset = _gain(image, reference)
        gains.append(gain)
        levels = np.rint((image.astype(np.float32) - offset) / gain)
        matched.append(np.clip(levels, 0, np.iinfo(image.dtype).max).astype(image.dtype))
    background = _median(matched)
    soft = cv2.GaussianBlur(background, (0, 0), _SMOOTH_PX)
    slack: Single = np.float32(_SHAKE_PX) * np.hypot(
        cv2.Sobel(soft, -1, 1, 0, scale=0.125), cv2.Sobel(soft, -1, 0, 1, scale=0.125)
    )
    frame_seeds: list[FrameSeeds] = []
    for index, image, gain in zip(chosen, matched, gains, strict=True):
        pixels, rivals = _seeds_of(image.astype(np.float32) - background, slack, shrink, upper_corner)
        frame_seeds.append(FrameSeeds(index, pixels, gain, rivals))
    return frame_seeds


def reduced(image: Image) -> tuple[Image, int]:
    """A frame in which a seed is found, and how many of the frame's pixels one of its pixels is wide."""
    shrink = max(1, round(image.shape[1] / _WIDE_PX))
    if shrink == 1:
        return image, 1
    size = (image.shape[1] // shrink, image.shape[0] // shrink)
    cropped = image[: size[1] * shrink, : size[0] * shrink]
    return np.asarray(cv2.resize(cropped, size, interpolation=cv2.INTER_AREA), image.dtype), shrink


def _gain(image: Image, reference: Single) -> tuple[float, float]:
    """Gain and offset that make the reference this image: a line by iteratively reweighted least squares."""
    step = max(1, int(np.sqrt(image.size / _SAMPLES)))
    x = reference[::step, ::step].ravel().astype(np.float64)
    y = image[::step, ::step].ravel().astype(np.float64)
    gain, offset = float(np.median(y) / max(np.median(x), 1.0)), 0.0
    for _ in range(_GAIN_ROUNDS):
        rest = y - gain * x - offset
        scale = max(1.4826 * float(np.median(np.abs(rest))), 0.5)
        weight = np.clip(1.0 - (rest / (4.685 * scale)) ** 2, 0.0, None) ** 2  # Tukey's biweight
        total = max(float(weight.sum()), 1e-9)
        mean_x, mean_y = float(weight @ x) / total, float(weight @ y) / total
        spread = float(weight @ (x - mean_x) ** 2)
        if spread < 1e-6:
            break
        gain = float(weight @ ((x - mean_x) * (y - mean_y))) / spread
        offset = mean_y - gain * mean_x
    return (gain, offset) if gain > 0.05 else (1.0, 0.0)


def _median(images: Sequence[Image]) -> Single:
    stack = np.stack(images)
    return np.partition(stack, len(images) // 2, axis=0)[len(images) // 2].astype(np.float32)


def _seeds_of(
    difference: Single, slack: Single, shrink: int, upper_corner: int
) -> tuple[dict[CornerName, Floats], int]:
    smooth = np.abs(cv2.GaussianBlur(difference, (0, 0), _SMOOTH_PX))
    noise = max(1.4826 * float(np.median(smooth)), 0.25)  # levels; rounding alone leaves a tenth after smoothing
    mask = (smooth > _NOISES * noise + slack).astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_CLOSE_PX, _CLOSE_PX))
    mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel), np.uint8)
    mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return {}, 0
    areas = stats[1:, cv2.CC_STAT_AREA]
    order = np.argsort(-areas, kind="stable")[:_MOST_BLOBS]
    if areas[order[0]] < _LEAST_SHARE * mask.size:
        return {}, 0
    pixels: dict[CornerName, list[Floats]] = {}
    blobs = [blob for blob in order.tolist() if areas[blob] >= _RIVAL_BLOB * areas[order[0]]]
    for blob in blobs:
        rows, columns = np.nonzero(labels == blob + 1)
        for name, seeds in _of_blob(np.column_stack([columns, rows]), mask.shape, upper_corner).items():
            pixels.setdefault(name, []).append((seeds + 0.5) * shrink - 0.5)
    return {name: np.concatenate(seeds) for name, seeds in pixels.items()}, len(blobs) - 1


def _of_blob(places: NDArray[np.int64], shape: tuple[int, ...], upper_corner: int) -> dict[CornerName, Floats]:
    """Seeds of a blob's pixels (N, 2), but for those at the frame's rim."""
    outline = cv2.convexHull(places.astype(np.int32))
    hull = cv2.approxPolyDP(outline, 1.5, closed=True).reshape(-1, 2).astype(np.float64)
    inside = np.all((hull > 1.0) & (hull < (shape[1] - 2.0, shape[0] - 2.0)), axis=1)
    by_corner: dict[CornerName, Floats] = {}
    if upper_corner:
        upper: dict[CornerName, int] = {"top": -upper_corner, "right" if upper_corner > 0 else "left": upper_corner}
        for name, side in upper.items():
            away = np.array([side * np.cos(_UPWARD), -np.sin(_UPWARD)])
            farthest = (hull @ away).argmax(axis=0)
            by_corner[name] = _apart(hull[farthest[inside[farthest]]], _APART * shape[1])
        return {name: pixels for name, pixels in by_corner.items() if len(pixels)}
    highest = _apart(hull[inside][np.argsort(hull[inside, 1], kind="stable")], _APART * shape[1])
    if len(highest):
        by_corner["top"] = highest
    ends: tuple[tuple[CornerName, int], ...] = (
        ("left", int(hull[:, 0].argmin())),
        ("right", int(hull[:, 0].argmax())),
    )
    for name, end in ends:
        if inside[end]:
            by_corner[name] = hull[end : end + 1]
    return by_corner


def _apart(ordered: Floats, distance: float) -> Floats:
    """The first few of the pixels (N, 2) that keep the distance from each other."""
    taken: list[Floats] = []
    for pixel in ordered:
        if all(np.hypot(*(pixel - other)) > distance for other in taken):
            taken.append(pixel)
        if len(taken) == _HIGHEST:
            break
    return np.array(taken, np.float64).reshape(-1, 2)
