"""Seeds of a frame that shows its board without help: by its chessboard, or by its outline.

A background tells nothing where the board hides one place in most frames, where the light changes, or where shadows
move. A chessboard is found in a single frame, and so is a plain board that is brighter or darker than all around it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from apexcal.documents.corners import CornerName
from workers.marks.seeds import FrameSeeds, reduced
from workers.marks.sights import Floats, FrameSource, Image

Contour = NDArray[np.int32]
_SMALLEST_GRIDS: Final = ((6, 5), (4, 3))
"""Inner corners from which OpenCV grows a chessboard. The larger first: it then finds more of the pattern."""
_PROBES: Final = 8  # frames: if too few of them have a chessboard, the recording has none
_LEAST_ALIKE: Final = 0.25  # of the frames have a chessboard of one size; mere noise has one in a tenth
_MARGINS: Final = (1.0, 1.5, 2.0)
"""Squares from the outermost inner corner to the board's edge: none, half a square or one beside the pattern."""
_LEVELS: Final = 33
_LEAST_SHARE: Final = 0.003  # of the frame: a board of 40 px a side, of 960 x 540
_MOST_SHARE: Final = 0.85
_CONVEX: Final = 0.93  # least share of its hull that a region fills: a hand holds the board
_STRAIGHT: Final = 0.015  # of the outline's length: what a side may bend
_FEWEST_SIDES: Final = 3
_MOST_SIDES: Final = 7  # a board that the frame cuts at three corners
_SAME: Final = 0.5  # of the smaller region
_MOST_OUTLINES: Final = 2
_RIM_PX: Final = 2
_LEAST_SHOWN: Final = 20  # pixels of an outline inside the frame
_AWAY: Final[tuple[tuple[CornerName, Floats], ...]] = (
    ("top", np.array([0.0, -1.0])),
    ("right", np.array([1.0, 0.0])),
    ("bottom", np.array([0.0, 1.0])),
    ("left", np.array([-1.0, 0.0])),
)


def find_chessboard_seeds(
    frames: FrameSource, chosen: Sequence[int], upper_corner: int = 0
) -> list[list[FrameSeeds]]:
    """Seeds of the chosen frames by the chessboard in each: a list for each width of the margin, none without one.

    Args:
        upper_corner: which corner ``top`` is (`workers.marks.seeds.find_seeds`).
    """
    images = [_small(frames[index]) for index in chosen]
    grids = _chessboards([small.image for small in images])
    if not grids:
        return []
    of_margins = ([[] if grid is None else [_outline(grid, margin)] for grid in grids] for margin in _MARGINS)
    return [_seeds(chosen, images, outlines, upper_corner) for outlines in of_margins]


def find_outline_seeds(frames: FrameSource, chosen: Sequence[int], upper_corner: int = 0) -> list[list[FrameSeeds]]:
    """Seeds of the chosen frames by the convex regions in each: one list. Arguments as of `find_chessboard_seeds`."""
    images = [_small(frames[index]) for index in chosen]
    return [_seeds(chosen, images, [_regions(small.image) for small in images], upper_corner)]


class _Small(NamedTuple):
    """A reduced frame of bytes, whose pixels are ``shrink`` of the frame's wide."""

    image: NDArray[np.uint8]
    shrink: int


def _small(frame: Image) -> _Small:
    image, shrink = reduced(frame)
    if image.dtype != np.uint8:
        image = cv2.normalize(image, np.empty_like(image), 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    return _Small(np.asarray(image, np.uint8), shrink)


def _seeds(
    chosen: Sequence[int], images: Sequence[_Small], outlines: Sequence[Sequence[Floats]], upper_corner: int
) -> list[FrameSeeds]:
    """The outlines' farthest corners in each direction, where the frame shows them."""
    turn = np.radians(45.0) * -upper_corner
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    seeds: list[FrameSeeds] = []
    for index, (image, shrink), of_frame in zip(chosen, images, outlines, strict=True):
        limit = (image.shape[1] - _RIM_PX, image.shape[0] - _RIM_PX)
        pixels: dict[CornerName, Floats] = {}
        for name, direction in _AWAY:
            farthest = np.array([corners[(corners @ (R @ direction)).argmax()] for corners in of_frame]).reshape(
                -1, 2
            )
            inside = farthest[np.all((farthest >= _RIM_PX) & (farthest < limit), axis=1)]
            if len(inside):
                pixels[name] = (inside + 0.5) * shrink - 0.5
        seeds.append(FrameSeeds(index, pixels))
    return seeds


def _chessboards(images: Sequence[NDArray[np.uint8]]) -> list[Floats | None]:
    """The inner corners (rows, columns, 2) px of the chessboard in each image, of about one size in all of them.

    Empty where too few images have one.
    """
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    largest: list[Floats | None] = []
    for image in images:
        largest.append(_largest_grid(image, flags | cv2.CALIB_CB_LARGER))
        if len(largest) == _PROBES and _common_size(largest) is None:
            break
    size = _common_size(largest)
    if size is None:
        return []
    grids: list[Floats | None] = []
    for image, grid in zip(images, largest, strict=True):
        if grid is None or _size(grid) != size:
            is_there, corners = cv2.findChessboardCornersSB(image, size, flags=flags)
            if is_there:
                grid = np.asarray(corners, np.float64).reshape(size[1], size[0], 2)
        is_alike = grid is not None and max(abs(a - b) for a, b in zip(_size(grid), size, strict=True)) <= 1
        grids.append(grid if is_alike else None)
    return grids


def _common_size(grids: Sequence[Floats | None]) -> tuple[int, int] | None:
    """The size of the pattern; sometimes only a part of it is found: such sizes are smaller, and each is rare."""
    sizes = Counter(_size(grid) for grid in grids if grid is not None)
    size = max(sizes, key=lambda size: sizes[size] * size[0] * size[1], default=(0, 0))
    return size if sizes[size] >= max(_LEAST_ALIKE * len(grids), 1) else None


def _size(grid: Floats) -> tuple[int, int]:
    rows, columns, _ = grid.shape
    return min(rows, columns), max(rows, columns)


def _largest_grid(image: NDArray[np.uint8], flags: int) -> Floats | None:
    """The inner corners (rows, columns, 2) px of a chessboard of unknown size."""
    for size in _SMALLEST_GRIDS:
        is_there, corners, meta = cv2.findChessboardCornersSBWithMeta(image, size, flags)
        if is_there:
            return np.asarray(corners, np.float64).reshape(*meta.shape[:2], 2)
    return None


def _outline(grid: Floats, margin: float) -> Floats:
    """The board's corners (4, 2) px, so many squares outside of the grid's."""
    rows, columns, _ = grid.shape
    places = np.array([[column, row] for row in range(rows) for column in range(columns)], np.float64)
    H, _ = cv2.findHomography(places, grid.reshape(-1, 2))
    low, right, bottom = -margin, columns - 1 + margin, rows - 1 + margin
    corners = np.array([[[low, low], [right, low], [right, bottom], [low, bottom]]], np.float64)
    return np.asarray(cv2.perspectiveTransform(corners, H)[0], np.float64)


def _regions(image: NDArray[np.uint8]) -> list[Floats]:
    """The outlines (K, 2) px of convex regions between grey levels, those with the strongest edges first."""
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), np.uint8)
    slope = np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    outlines: list[tuple[float, Floats]] = []
    for level in np.unique(np.quantile(smooth, np.linspace(0.0, 1.0, _LEVELS + 2)[1:-1]).round()):
        for mask in (smooth > level, smooth < level):
            for contour in _contours(mask.astype(np.uint8)):
                outline = _convex(contour, image.size)
                if outline is not None:
                    outlines.append((_strength(contour, slope), outline))
    taken: list[Floats] = []
    for _, outline in sorted(outlines, key=lambda pair: -pair[0]):
        if not any(_overlap(outline, other) for other in taken):
            taken.append(outline)
        if len(taken) == _MOST_OUTLINES:
            break
    return taken


def _contours(mask: NDArray[np.uint8]) -> list[Contour]:
    contours = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    return [np.asarray(contour, np.int32) for contour in contours]


def _convex(contour: Contour, frame_area: int) -> Floats | None:
    """A contour's corners (K, 2) px, if a board may look like it."""
    area = cv2.contourArea(contour)
    if not _LEAST_SHARE * frame_area < area < _MOST_SHARE * frame_area:
        return None
    hull = cv2.convexHull(contour)
    if area < _CONVEX * cv2.contourArea(hull):
        return None
    corners = cv2.approxPolyDP(hull, _STRAIGHT * cv2.arcLength(hull, closed=True), closed=True)
    return corners.reshape(-1, 2).astype(np.float64) if _FEWEST_SIDES <= len(corners) <= _MOST_SIDES else None


def _strength(contour: Contour, slope: NDArray[np.float32]) -> float:
    """The sum of the grey levels' slopes along a contour, without the frame's rim."""
    column, row = contour.reshape(-1, 2).T
    height, width = slope.shape
    shown = (column >= _RIM_PX) & (row >= _RIM_PX) & (column < width - _RIM_PX) & (row < height - _RIM_PX)
    return float(slope[row[shown], column[shown]].sum()) if shown.sum() >= _LEAST_SHOWN else 0.0


def _overlap(outline: Floats, other: Floats) -> bool:
    pair = outline.astype(np.float32), other.astype(np.float32)
    common, _ = cv2.intersectConvexConvex(*pair)
    return common > _SAME * min(cv2.contourArea(each) for each in pair)
