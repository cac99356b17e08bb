"""Requests and answers about points in 3D: the ray of a pixel, and the LiDAR's points along it."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self
from uuid import UUID

from pydantic import Field, model_validator

from apexcal.documents.analyses import AnalysisView
from apexcal.documents.base import Document, Magnitude, Name, Received, Stored
from apexcal.documents.validations import ValidationRequest

MOST_PIXELS: Final = 50
"""Of one request. Each may have 1000 points: all together are a megabyte of JSON."""
_Deviation = Annotated[float, Field(gt=0, le=100, allow_inf_nan=False)]


class UncertainPixel(Received):
    """A pixel, and one standard deviation of each of its coordinates."""

    u: Magnitude
    v: Magnitude
    sigma_px: _Deviation = 1.0


class LidarNoise(Received):
    """Standard deviations of the LiDAR's points.

    ``range_m``: of each range by itself. ``shared_m``: of what all ranges err by together, which no fit of a plane
    shows. ``angle_deg``: of each beam, in any direction across it. Data sheets of spinning LiDARs state 0.03 m for
    both errors of the range together, which is taken as two deviations of either, and 0.01 degrees.
    """

    range_m: Annotated[float, Field(gt=0, le=1)] = 0.015
    shared_m: Annotated[float, Field(ge=0, le=1)] = 0.015
    angle_deg: Annotated[float, Field(gt=0, le=5)] = 0.01


class PixelPointsRequest(ValidationRequest):
    """Ask which points in 3D pixels of a camera show, at a ``frame`` or at ``stamp_ns`` of the camera's clock.

    The calibration is ``result_id``, or ``calibration``, or else what the camera is given now. ``k``: how many
    standard deviations wide the cone about each ray is. ``clock_offset_ns`` is the camera's clock minus the LiDAR's;
    without it, the one under which the pairs of the result were made, or 0.
    """

    kind: Literal["pixel_points"]
    recording_id: UUID
    camera: Name
    frame: Annotated[Annotated[int, Field(ge=0, lt=2**31)] | None, Field(examples=[20])] = None
    stamp_ns: Annotated[int, Field(ge=0, lt=2**63)] | None = None
    pixels: Annotated[list[UncertainPixel], Field(min_length=1, max_length=MOST_PIXELS)]
    k: Annotated[float, Field(gt=0, le=10)] = 3.0
    lidar_noise: LidarNoise = LidarNoise()
    clock_offset_ns: Annotated[int, Field(ge=-(2**62), le=2**62)] | None = None

    @model_validator(mode="after")
    def _names_one_moment(self) -> Self:
        if (self.frame is None) == (self.stamp_ns is None):
            raise ValueError("give either frame or stamp_ns")
        return self


class LocatedPixel(Document):
    """The point that one pixel shows, in the LiDAR frame.

    ``origin`` (m) and ``direction`` (unit) of its ray, with ``direction_covariance`` (3 x 3, rad^2) by pixel and
    calibration; null if the pixel has no ray. ``points``: the LiDAR's points (m) in the cone. If they form a plane,
    ``point`` (m) is where the ray meets it, ``covariance`` (3 x 3, m^2) by calibration, pixel and plane, and
    ``normal`` (unit, towards the camera). Otherwise ``reason`` says why not.
    """

    u: float
    v: float
    origin: list[float] | None = None
    direction: list[float] | None = None
    direction_covariance: list[list[float]] | None = None
    points: list[list[float]] = []
    point: list[float] | None = None
    covariance: list[list[float]] | None = None
    normal: list[float] | None = None
    reason: str | None = None


class LocatedPixels(Document):
    """The points that the pixels show, in their order; the sweep that was read, and its stamp (the LiDAR's clock)."""

    sweep: int
    sweep_stamp_ns: int
    pixels: list[LocatedPixel]


class PixelPointsView(AnalysisView):
    """Points of pixels."""

    kind: Literal["pixel_points"]
    camera: str
    result: Stored[LocatedPixels | None]
