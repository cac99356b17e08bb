"""Exports: the table of formats, and a URDF to patch."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from apexcal.documents.base import Received, Sent

# Header with the vehicle's id, in every answer for a whole vehicle and in each format.
VEHICLE_HEADER = "Apexcal-Vehicle"
Link = Annotated[str, Field(min_length=1, max_length=200)]


class FormatView(Sent):
    """A format: the direction of its transform, and the ``lenses`` that it carries (none if it has mounts alone).

    ``media_type`` asks for it in an Accept header. The media type of an answer also names the kind of its bytes,
    after a ``+``.
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
    """A vehicle's URDF file, and the fixed joint that takes the calibrated pose.

    In place of a URDF it may be Autoware's ``sensor_kit_calibration.yaml`` or ``sensors_calibration.yaml``; the joint
    is then the child's entry. Unless stated, the links of camera and LiDAR bear the names of their frames.
    """

    urdf: Annotated[str, Field(max_length=250_000)]
    joint: Annotated[str, Field(max_length=200)]
    camera_link: Link | None = None
    lidar_link: Link | None = None
