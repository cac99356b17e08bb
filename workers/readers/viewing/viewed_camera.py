"""A camera as a viewer's file needs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from workers.readers.viewing.messages import ViewerLens


@dataclass(frozen=True, slots=True)
class ViewedCamera:
    """A camera of the recording as calibrated.

    Attributes:
        name: the camera's name in the rig.
        frame_id: its optical frame.
        file: its normalised recording. table: where its frames stand in it.
        map: an .npy file, (height, width, 2) float32: for each pixel of the undistorted image the pixel of the frame;
            it lies outside of the frame where the lens sees nothing.
        clock_offset_ns: its clock minus the LiDAR's.
        raw: the lens; None if no message can carry it.
        pinhole: that of the undistorted image.
    """

    name: str
    frame_id: str
    file: Path
    table: Path
    map: Path
    clock_offset_ns: int
    raw: ViewerLens | None
    pinhole: ViewerLens

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """From plain data, as the worker plans it."""
        return cls(
            name=data["name"],
            frame_id=data["frame_id"],
            file=Path(data["file"]),
            table=Path(data["table"]),
            map=Path(data["map"]),
            clock_offset_ns=int(data["clock_offset_ns"]),
            raw=ViewerLens(**data["raw"]) if data["raw"] else None,
            pinhole=ViewerLens(**data["pinhole"]),
        )
