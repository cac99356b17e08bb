"""Exports: the table of formats, a URDF to patch, and all that a vehicle is given."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated
from uuid import UUID

from pydantic import Field

from apexcal.documents.base import Received, Sent
from apexcal.documents.summaries import CurrentCalibration

# With every answer for a whole vehicle, in each format: the id of the vehicle that it is of.
VEHICLE_HEADER = "Apexcal-Vehicle"
Link = Annotated[str, Field(min_length=1, max_length=200)]


class FormatView(Sent):
    """A format: which way its transform leads, and what of a lens it carries; ``lenses`` is empty for mounts alone.

    ``media_type`` is its name in an Accept header; an answer's type says with ``+`` what its bytes are.
    """

    name: str
    title: str
    media_type: str
    direction: str
    lenses: list[str]
    skew: bool
    third_radial: bool
    needs_T_vehicle_lidar: bool  # noqa: N815 - a transform
    one_lidar: bool


class UrdfRequest(Received):
    """A vehicle's URDF file, and the fixed joint of it that is to be as calibrated.

    Or Autoware's ``sensor_kit_calibration.yaml`` (``sensors_calibration.yaml``), and the entry that is the child.

    The links of the camera's optical frame and of the LiDAR are named like their frames, where nothing else is said.
    """

    urdf: Annotated[str, Field(max_length=250_000)]
    joint: Annotated[str, Field(max_length=200)]
    camera_link: Link | None = None
    lidar_link: Link | None = None


class VehicleCalibration(Sent):
    """What all cameras of a vehicle are given, by camera; ``without`` names those that nothing was published for.

    ``as_of`` is null for now.
    """

    vehicle_id: UUID
    vehicle: str
    as_of: datetime | None
    cameras: dict[str, CurrentCalibration]
    without: list[str]
    alias: str = "current"
