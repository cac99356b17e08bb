"""Bodies of the routes about fleets, vehicles and rigs."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Self
from uuid import UUID

from pydantic import AfterValidator, Field, StringConstraints, field_validator, model_validator

from apexcal.documents.base import Magnitude, Name, Received, Sent, Stored, Topic, legible_text
from apexcal.documents.camera_models import ANGLES, EXTRINSICS, MODELS, all_names
from apexcal.documents.publications import PublicationPolicy
from apexcal.documents.readings import ImageKind
from apexcal.documents.roles import Role
from apexcal.documents.transforms import Matrix, Transform, check_frames

# A camera's name stands in addresses.
CameraName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
# A rig may serve every model and both forms of the search; angles are radians, or degrees with `_deg` behind.
_BOUNDED = frozenset(name for form in EXTRINSICS for name in all_names(MODELS, form)) | {
    f"{angle}_deg" for angle in ANGLES
}
Pixels = Annotated[int, Field(ge=16, le=32768)]


# As it stands on the sensor.
Serial = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200), AfterValidator(legible_text)
]


class Named(Received):
    """The name of something to make or change."""

    name: Name


class FleetOut(Sent):
    """A fleet. It takes ``taken_bytes`` of the ``quota_bytes`` that it may, ``row_bytes`` of them in the database."""

    id: UUID
    name: str
    role: Role | None
    taken_bytes: int
    row_bytes: int
    quota_bytes: int
    policy: Stored[PublicationPolicy | None] = None
    version: int
    created_at: datetime


class VehicleOut(Sent):
    """A vehicle."""

    id: UUID
    fleet_id: UUID
    name: str
    version: int
    created_at: datetime


class Lidar(Received):
    """The rig's LiDAR: its frame, its topic where a recording has several, and its serial number where known."""

    frame: Annotated[Name, Field(examples=["lidar"])]
    topic: Topic | None = None
    serial: Serial | None = None


class OwnedJoint(Received):
    """The joint of the vehicle's own tree that a camera's calibration is solved for, by what lies around it.

    Results then carry ``T_parent_child`` = ``T_parent_lidar`` ``T_lidar_camera`` ``T_camera_child``, the child's pose
    in its parent. If the parent is the LiDAR's frame, or the child the camera's, the transform is the identity.
    """

    T_parent_lidar: Transform
    T_child_camera: Transform


class Images(Received):
    """The kind of a camera's images. ``rotation`` is R of its CameraInfo, if these are rectified.

    It turns from the camera's ``frame`` to that of its images. Without it ``frame`` is the frame of the images.
    """

    kind: ImageKind
    rotation: Matrix | None = None


class Camera(Received):
    """A camera: its optical frame, image size (width, height), nominal ``T_camera_lidar`` and bounds.

    ``serial`` is its serial number, where known. ``joint`` is the joint that its results are also given for.
    ``images``: raw or rectified; null until its first recording tells.
    """

    name: CameraName
    frame: Name
    topic: Topic | None = None
    serial: Serial | None = None
    image_size: Annotated[tuple[Pixels, Pixels], Field(examples=[[1920, 1200]])]
    nominal: Transform
    joint: OwnedJoint | None = None
    images: Images | None = None
    bounds: dict[str, tuple[Magnitude, Magnitude]] = Field(default_factory=dict, max_length=40)

    @field_validator("bounds")
    @classmethod
    def _right_way_round(cls, bounds: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        for name, (low, high) in bounds.items():
            if name not in _BOUNDED:
                raise ValueError(f"there is no parameter {name!r} to bound; there are {', '.join(sorted(_BOUNDED))}")
            if not low < high:
                raise ValueError(f"the bounds of {name} are inside out: {low:g} is not below {high:g}")
        return bounds


class CameraTransform(Received):
    """``T_cameraA_cameraB`` as known otherwise, with the standard deviation of each axis."""

    transform: Transform
    std_deg: Annotated[float, Field(ge=1e-6, le=180, allow_inf_nan=False)]
    std_mm: Annotated[float, Field(ge=1e-6, le=1e5, allow_inf_nan=False)]


class NewRig(Received):
    """A rig to make."""

    name: Name
    lidar: Lidar
    T_vehicle_lidar: Transform | None = None
    cameras: Annotated[list[Camera], Field(min_length=1, max_length=16)]
    camera_transforms: Annotated[list[CameraTransform], Field(default_factory=list, max_length=240)]

    @model_validator(mode="after")
    def _frames_meet(self) -> Self:
        names = [camera.name for camera in self.cameras]
        frames = [camera.frame for camera in self.cameras]
        if len(set(names)) < len(names) or len({*frames, self.lidar.frame}) < len(frames) + 1:
            raise ValueError("every camera has its own name, and every sensor its own frame")
        for camera in self.cameras:
            check_frames(
                camera.nominal, f"the nominal T_camera_lidar of {camera.name}", camera.frame, self.lidar.frame
            )
            _check_joint(camera, self.lidar.frame)
        if self.T_vehicle_lidar is not None:
            vehicle = self.T_vehicle_lidar
            check_frames(vehicle, "T_vehicle_lidar", vehicle.to_frame, self.lidar.frame)
        for index, edge in enumerate(self.camera_transforms):
            named = edge.transform
            if named.to_frame == named.from_frame or not {named.to_frame, named.from_frame} <= set(frames):
                raise ValueError(
                    f"camera_transforms[{index}] leads from {named.from_frame!r} to {named.to_frame!r}; it takes the "
                    f"frames of two of the rig's cameras: {', '.join(frames)}"
                )
        return self


def _check_joint(camera: Camera, lidar_frame: str) -> None:
    """Raises ValueError unless a camera's joint stands between LiDAR and camera."""
    if camera.joint is None:
        return
    parent, child = camera.joint.T_parent_lidar, camera.joint.T_child_camera
    check_frames(parent, f"joint.T_parent_lidar of {camera.name}", parent.to_frame, lidar_frame)
    check_frames(child, f"joint.T_child_camera of {camera.name}", child.to_frame, camera.frame)
    if parent.to_frame in (child.to_frame, camera.frame) or child.to_frame == lidar_frame:
        raise ValueError(
            f"the joint of {camera.name} leads from {parent.to_frame!r} to {child.to_frame!r}; its parent lies on "
            "the LiDAR's side and its child on the camera's"
        )


class SensorSerials(Received):
    """Serial numbers of a rig's sensors, to correct or complete those stated; null removes one.

    For a swapped sensor describe a new rig: recordings and results belong to the sensors that were mounted.
    """

    lidar: Serial | None = None
    cameras: Annotated[dict[CameraName, Serial | None], Field(default_factory=dict, max_length=16)]


class CameraImages(Received):
    """The corrected kinds of the images of a rig's cameras; null lets the next recording tell."""

    cameras: Annotated[dict[CameraName, Images | None], Field(default_factory=dict, max_length=16)]


class RigOut(Sent):
    """A rig."""

    id: UUID
    fleet_id: UUID
    vehicle_id: UUID
    name: str
    lidar: Stored[Lidar]
    T_vehicle_lidar: Stored[Transform | None]
    cameras: Stored[list[Camera]]
    camera_transforms: Stored[list[CameraTransform]]
    policy: Stored[PublicationPolicy | None] = None
    version: int
    created_at: datetime
