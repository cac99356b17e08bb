"""Pictures of crops: the tile that the worker cut when it marked, or else the whole frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from urllib.parse import quote
from uuid import UUID

from apexcal.documents.crops import CropImage
from apexcal.documents.machine_marks import TILE_COLUMNS
from service.crops.shifts import MarkLimits
from service.platform.db.base import Json
from service.platform.db.recordings import Sensor

# Least distance, in sides of a crop, of a mark from an edge of its tile that is no edge of the frame.
_INSIDE: Final = 0.5


@dataclass(frozen=True, slots=True)
class Tile:
    """A piece of a frame: where it lies there (px), and its bytes in the file of the analysis."""

    tile_u: int
    tile_v: int
    tile_width: int
    tile_height: int
    tile_offset: int
    tile_length: int


def tile_of(row: Json) -> Tile | None:
    """The tile of a mark, or of a page's crop; None where the worker had no room for it."""
    values = [row.get(name) for name in TILE_COLUMNS]
    return None if None in values else Tile(*values)  # pyright: ignore[reportArgumentType] - none is None


def limits_in(tile: Tile | None, side_px: float, width: int, height: int) -> MarkLimits:
    """Least and largest u, and v, at which a mark can be drawn in a frame of this size."""
    if tile is None:
        return (0.0, width - 1.0), (0.0, height - 1.0)
    return (
        _span(tile.tile_u, tile.tile_width, side_px, width),
        _span(tile.tile_v, tile.tile_height, side_px, height),
    )


def _span(start: int, length: int, side_px: float, size: int) -> tuple[float, float]:
    """Return the first and last pixel of marks along one axis. At the frame's own edge a crop may reach out of it."""
    first = 0.0 if start == 0 else start + _INSIDE * side_px
    last = size - 1.0 if start + length == size else start + length - 1 - _INSIDE * side_px
    return first, last


def image_of(
    crop: Json, index: int, page_id: UUID, camera: Sensor, frame_index: int, width: int, height: int
) -> CropImage:
    """The picture of a page's crop of this index, of a frame of this size."""
    tile = tile_of(crop)
    if tile is not None:
        url = f"/v1/crop-pages/{page_id}/crops/{index}"
        return CropImage(url=url, u=tile.tile_u, v=tile.tile_v, width=tile.tile_width, height=tile.tile_height)
    address = f"/v1/recordings/{camera.recording_id}/cameras/{quote(camera.name, safe='')}/frames"
    return CropImage(url=f"{address}/{frame_index}", u=0, v=0, width=width, height=height)
