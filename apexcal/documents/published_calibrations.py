"""The calibrations that a vehicle gets: each camera's document, and that of all cameras."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from apexcal.documents.base import Document, Sent, Stored
from apexcal.documents.checks import CheckVerdict
from apexcal.documents.precision import Deviations
from apexcal.documents.publications import OverrideView
from apexcal.documents.results import Intrinsics
from apexcal.documents.transforms import SolvedTransform


class Quality(Document):
    """The quality of a published calibration.

    ``std`` includes the spread of the models that held-out pairs do not rule out; ``std_of_model`` holds if the model
    is right. ``verdict`` is the gravest of its checks when its calibration ended, for the mount with its lens.
    """

    pairs: int
    mean_px: float
    rms_px: float
    heldout_mean_px: float | None
    heldout_rms_px: float | None
    std: Deviations
    std_of_model: Deviations
    interval95_half_width: Deviations
    verdict: CheckVerdict | None


class Validity(Document):
    """Since when a calibration is given, and for which sensors. ``until`` (for past moments) is when it was replaced.

    Serial numbers are null where the rig states none.
    """

    since: datetime
    until: datetime | None = None
    camera_serial: str | None = None
    lidar_serial: str | None = None


class CurrentCalibration(Sent):
    """The calibration that a vehicle's camera gets: intrinsics, transforms with both frames named, and quality.

    ``T_vehicle_camera`` is there if the rig states ``T_vehicle_lidar``, ``T_parent_child`` if it states the camera's
    ``joint``: the child's pose in its parent. ``clock_offset_ns`` is the camera's clock
    minus the LiDAR's with which the pairs were made, null if they were imported. Under an alias other than
    ``current``, ``publication_id`` is the id of the alias's move.
    """

    vehicle_id: UUID
    camera: str
    published_at: datetime
    published_by: str | None
    reason: str | None
    override: OverrideView | None
    publication_id: UUID
    result_id: UUID
    calibration_id: UUID
    model: str
    intrinsics: Stored[Intrinsics]
    T_camera_lidar: Stored[SolvedTransform]
    quality: Quality
    T_vehicle_camera: SolvedTransform | None = None
    T_parent_child: SolvedTransform | None = None
    alias: str = "current"
    clock_offset_ns: int | None = None
    validity: Validity | None = None


class VehicleCalibration(Sent):
    """The published calibrations of a vehicle, by camera; ``without`` names the cameras that have none.

    ``as_of`` is null for now.
    """

    vehicle_id: UUID
    vehicle: str
    as_of: datetime | None
    cameras: dict[str, CurrentCalibration]
    without: list[str]
    alias: str = "current"
