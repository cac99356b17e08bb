"""Errors that all pairs of a camera share: their names, and their standard deviations in a request."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from apexcal.documents.base import Received

_Turn = Annotated[float, Field(ge=0, le=10)] | None
_Size = Annotated[float, Field(ge=0, le=1000)] | None

CommonError = Literal[
    "azimuth_deg",
    "elevation_deg",
    "tip_across_mm",
    "tip_up_mm",
    "range_mm",
    "tilt_up_deg",
    "tilt_across_deg",
    "corners_out_mm",
    "mark_u_px",
    "mark_v_px",
    "clock_ms",
    "line_time_us",
    "person_px",
]


class CommonErrors(Received):
    """Standard deviations of errors that all pairs of a camera share, which no pair can tell from the mount."""

    azimuth_deg: _Turn = Field(default=None, description="of all vertices, as the LiDAR sees them, degrees")
    elevation_deg: _Turn = Field(default=None, description="of all vertices, as the LiDAR sees them, degrees")
    tip_across_mm: _Size = Field(
        default=None, description="millimetres, of the board's edges: all tips lie to one side"
    )
    tip_up_mm: _Size = Field(
        default=None, description="millimetres, of the board's edges and its worn tip: all lie too high"
    )
    range_mm: _Size = Field(default=None, description="of the LiDAR's range, millimetres")
    tilt_up_deg: _Turn = Field(default=None, description="of the boards of all poses about a level axis, degrees")
    tilt_across_deg: _Turn = Field(
        default=None, description="of the boards of all poses about an upright axis, degrees"
    )
    corners_out_mm: _Size = Field(
        default=None, description="of all of a pose's corners, away from its middle, millimetres"
    )
    mark_u_px: _Size = Field(default=None, description="of all marks, to the right, pixels")
    mark_v_px: _Size = Field(default=None, description="of all marks, down, pixels")
    clock_ms: _Size = Field(default=None, description="of the offset between the clocks, milliseconds")
    line_time_us: _Size = Field(default=None, description="of the stated line_time_us, microseconds")
    person_px: _Size = Field(
        default=None, description="of one person's marks, each axis, pixels; several people's pairs correct it"
    )
