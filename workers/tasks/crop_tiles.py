"""Pieces of frames around the machine's marks. People look at 24 of them at once; whole frames would take long."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from apexcal.documents.crops import MOST_SHIFT_SHARE, expected_pixel, side_of
from apexcal.documents.machine_marks import TILE_COLUMNS
from workers.marks.sights import Image
from workers.readers.images.deep_images import shown_levels

_HALF: Final = 0.5 + MOST_SHIFT_SHARE
"""Half of a tile over the crop's side: half a crop about a mark, shifted or not, that is off the tile's middle."""


def write_tiles(
    rows: Sequence[dict[str, Any]], frame_of: Mapping[str, int], frames: Iterable[tuple[int, Image]], file: Path
) -> None:
    """Write a PNG of each mark into one file, and where it is into the mark's row (`TILE_COLUMNS`).

    A mark that lies far outside of its frame has none.

    ``rows``: marks with ``vertex_id``, ``u``, ``v``, ``edge_px`` (px) and ``reason``. ``frame_of``: the index of each
    vertex's frame. ``frames``: indices and (H, W, 3) BGR or (H, W) grey; 16 bits are shown as in the frame's PNG.
    """
    marks: defaultdict[int, list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if row["reason"] is None:
            marks[frame_of[row["vertex_id"]]].append(row)
    offset = 0
    with file.open("wb") as out:
        for row, image in ((row, image) for index, image in frames for row in marks[index]):
            if image.dtype == np.uint16:
                image = shown_levels(image.astype(np.uint16, copy=False))
            side = side_of(row["edge_px"])
            u, v = expected_pixel(row)
            (left, right), (top, bottom) = (_span(u, side, image.shape[1]), _span(v, side, image.shape[0]))
            if left >= right or top >= bottom:
                continue
            data = cv2.imencode(".png", np.ascontiguousarray(image[top:bottom, left:right]))[1].tobytes()
            out.write(data)
            span = (left, top, right - left, bottom - top, offset, len(data))
            row.update(zip(TILE_COLUMNS, span, strict=True))
            offset += len(data)


def _span(middle: float, side: float, size: int) -> tuple[int, int]:
    """The first pixel of a tile along one axis, and the one behind its last."""
    return max(0, int(middle - _HALF * side)), min(size, int(np.ceil(middle + _HALF * side)) + 1)
