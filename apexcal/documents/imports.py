"""Calibrations that other programs wrote: files to read, what they hold, and how a result compares with them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from apexcal.documents.base import Name, Received, Sent
from apexcal.documents.camera_models import ModelName
from apexcal.documents.fleets import Pixels
from apexcal.documents.transforms import SolvedTransform, Transform

ImportFormat = Literal[
    "camera_info",
    "opencv",
    "opencv_stereo",
    "kalibr",
    "euroc",
    "kitti",
    "fast_livo2",
    "camodocal",
    "orb_slam",
    "direct_visual",
    "sensors_calibration",
    "nuscenes",
]
FileText = Annotated[str, Field(max_length=60_000)]


class CalibrationFiles(Received):
    """Files of one calibration, by name: one file, or those that belong together, as
    KITTI's ``calib_*.txt``.

    ``format`` is told by the content if it is left out. ``image_size`` (width, height) is for files that state none.
    """

    files: Annotated[dict[Name, FileText], Field(min_length=1, max_length=4)]
    format: ImportFormat | None = None
    image_size: tuple[Pixels, Pixels] | None = None


class ReadLens(Sent):
    """A lens as ``intrinsics`` of a calibration takes it. ``model`` is our camera model."""

    width: int
    height: int
    distortion_model: str
    K: list[float]
    D: list[float]
    model: ModelName


class ReadCamera(Sent):
    """A camera as the file names it. ``doubts`` say what is implausible.

    ``T_camera_lidar`` maps LiDAR points into the camera, if the file holds a LiDAR.
    """

    name: str
    topic: str | None = None
    lens: ReadLens | None = None
    T_camera_lidar: SolvedTransform | None = None
    doubts: list[str]


class ReadFiles(Sent):
    """The contents of calibration files. ``camera_transforms``: between cameras; ``notes`` name what was left out."""

    format: ImportFormat
    cameras: list[ReadCamera]
    camera_transforms: list[SolvedTransform]
    notes: list[str]


class ComparisonRequest(Received):
    """A mount or lens to compare a result with: a transform, or files.

    ``camera`` is the camera's name in the files, if they hold several.
    """

    T_camera_lidar: Transform | None = None
    files: CalibrationFiles | None = None
    camera: Name | None = None


class LensDifference(Sent):
    """The result's lens minus the stated one, pixels."""

    f_x: float
    f_y: float
    c_x: float
    c_y: float


class StatedComparison(Sent):
    """The distance of a result's mount and lens from stated ones.

    ``read_as``: ``stated`` if the transform is within 30 degrees of the result's as it stands. Otherwise which other
    reading would be: ``inverted`` (it maps camera points into the LiDAR), ``body`` (its camera looks along x, not z),
    ``inverted_body`` (both); ``none`` if no reading is. The numbers are always of the transform as it stands.
    ``sigmas`` is the root mean square of the difference in the result's own standard deviations, null if these are
    not known; ``differs``: by more than chance does once in 1000, if the stated mount is exact.
    """

    T_camera_lidar: SolvedTransform | None
    rotation_deg: float | None
    translation_mm: float | None
    sigmas: float | None
    differs: bool | None
    read_as: Literal["stated", "inverted", "body", "inverted_body", "none"] | None
    lens: LensDifference | None
    hints: list[str]
