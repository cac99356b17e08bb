"""The calibrated cameras of one vehicle, each with its lens and its mount: the data of every export.

A calibration changes one edge of the vehicle's tree; :func:`poses` is the tree around it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from apexcal.documents.camera_models import CAMERA_MODELS, CameraModel, ModelName, WrittenAs, parse_model
from apexcal.documents.results import StatedLensFit
from apexcal.geometry.se3 import SE3, Floats, from_document


@dataclass(frozen=True)
class SolvedJoint:
    """The joint of the vehicle's own tree that a camera is calibrated for, by what lies around it."""

    T_parent_lidar: SE3
    T_child_camera: SE3


@dataclass(frozen=True)
class CalibratedCamera:
    """A camera's lens and mount. ``intrinsics`` is a result's: pixels, and coefficients without a unit.

    ``marked`` are the pixels (n, 2) of the pairs. ``T_camera_lidar`` maps LiDAR points into the optical frame
    (x right, y down, z forward) of the images. ``source`` is the id of the result. ``T_own_camera`` leads from there
    to the camera's own frame, which the vehicle's tree has; None if they are the same. ``mount_checks`` are the
    sentences of the checks that the mount alone does not pass.
    """

    name: str
    topic: str | None
    width: int
    height: int
    model: ModelName
    intrinsics: Mapping[str, float]
    T_camera_lidar: SE3
    T_vehicle_lidar: SE3 | None
    rig: str
    source: str
    at: datetime
    marked: Floats
    joint: SolvedJoint | None = None
    is_rectified: bool = False
    T_own_camera: SE3 | None = None
    stated: StatedLensFit | None = None
    mount_checks: Sequence[str] = ()

    @property
    def _stated(self) -> StatedLensFit | None:
        """The mount under the stated lens; None if the pairs contradict that lens."""
        return None if self.stated is None or self.stated.explains is False else self.stated

    def alone(self) -> CalibratedCamera:
        """The camera for a format without lenses: the vehicle then projects through the stated lens."""
        if (stated := self._stated) is None:
            return self
        T_camera_lidar = replace(from_document(stated.transform), to_frame=self.frame)
        model = parse_model(stated.intrinsics.model)
        return replace(self, model=model, intrinsics=stated.intrinsics.by_name(), T_camera_lidar=T_camera_lidar)

    def undistorted(self) -> CalibratedCamera:
        """The camera of images that were undistorted to the same camera matrix, without skew."""
        lens = {name: self.intrinsics[name] for name in CAMERA_MODELS["pinhole"].intrinsics}
        return replace(self, model="pinhole", intrinsics=lens)

    def needs(self, *, carries_lens: bool = False) -> str:
        """The lens that the vehicle has to use with this mount, as a sentence.

        It is the result's own where the format carries that, else the one of :meth:`alone`.
        """
        own = f"the lens of its result alone: load that too (GET /v1/results/{self.source}?format=camera_info)."
        lens = own if carries_lens or not self._stated else "the stated lens (CameraInfo)."
        return f"{self.name}: this mount holds with {lens} {self.stated.sentence if self.stated else ''}".strip()

    @property
    def skew(self) -> float:
        """u = f_x (a_d + skew b_d) + c_x."""
        return float(self.intrinsics.get("skew", 0.0))

    @property
    def _record(self) -> CameraModel:
        return CAMERA_MODELS[self.model]

    @property
    def D(self) -> list[float]:  # noqa: N802 - a vector
        """The distortion in OpenCV's order; k1 k2 p1 p2 k3, all 0, of a pinhole."""
        return [float(self.intrinsics[name]) for name in self._record.distortion] or [0.0] * 5

    @property
    def lens(self) -> ModelName:
        """The model that a format must know: a ``brown_conrady`` without distortion is a pinhole's."""
        return "pinhole" if self._record.is_radial_tangential and not any(self.D) else self.model

    @property
    def written_as(self) -> WrittenAs:
        """The model's names in other programs' files; formats whose ``lenses`` have it need one."""
        names = self._record.written_as
        assert names is not None
        return names

    @property
    def K(self) -> list[list[float]]:  # noqa: N802 - a matrix
        """The camera matrix by rows, with f_x skew in its first."""
        f_x, f_y, c_x, c_y = (float(self.intrinsics[name]) for name in ("f_x", "f_y", "c_x", "c_y"))
        return [[f_x, f_x * self.skew, c_x], [0.0, f_y, c_y], [0.0, 0.0, 1.0]]

    @property
    def frame(self) -> str:
        """The optical frame."""
        return self.T_camera_lidar.to_frame

    @property
    def T_own_lidar(self) -> SE3:  # noqa: N802 - a transform
        """LiDAR points into the camera's own frame, before its images were rectified."""
        return self.T_own_camera @ self.T_camera_lidar if self.T_own_camera else self.T_camera_lidar

    @property
    def lidar_frame(self) -> str:
        """The LiDAR's frame."""
        return self.T_camera_lidar.from_frame

    @property
    def T_lidar_camera(self) -> SE3:  # noqa: N802 - a transform
        """The camera's pose in the LiDAR's frame."""
        return self.T_camera_lidar.inverse()

    @property
    def T_parent_child(self) -> SE3 | None:  # noqa: N802 - a transform
        """The child's pose in its parent, of the joint that the rig states."""
        if self.joint is None:
            return None
        return self.joint.T_parent_lidar @ self.T_lidar_camera @ self.joint.T_child_camera.inverse()


@dataclass(frozen=True)
class Calibrated:
    """One vehicle's cameras, at least one, in the order of the rig."""

    vehicle: str
    cameras: Sequence[CalibratedCamera]

    def alone(self) -> Calibrated:
        """The mounts for a format without lenses."""
        return replace(self, cameras=[camera.alone() for camera in self.cameras])

    @property
    def lidar_frames(self) -> list[str]:
        """Each LiDAR's frame, once."""
        return list(dict.fromkeys(camera.lidar_frame for camera in self.cameras))

    def T_root_lidar(self, lidar_frame: str) -> SE3 | None:  # noqa: N802 - a transform
        """The LiDAR's pose in the vehicle, else in the first joint's parent; None if no rig states either."""
        of = [camera for camera in self.cameras if camera.lidar_frame == lidar_frame]
        vehicles = [camera.T_vehicle_lidar for camera in of if camera.T_vehicle_lidar]
        parents = [camera.joint.T_parent_lidar for camera in of if camera.joint]
        return next((pose for pose in (*vehicles, *parents) if pose.to_frame != lidar_frame), None)


def file_name(name: str) -> str:
    """A name that is one plain step of a path everywhere."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_") or "unnamed"


def solved_edge(camera: CalibratedCamera) -> SE3:
    """The one edge that the calibration changes: the child's pose in its parent.

    It is the joint that the rig states. Without one it is the optical frame below the LiDAR's.
    """
    return camera.T_parent_child or camera.T_lidar_camera


def poses(calibrated: Calibrated) -> list[SE3]:
    """Each frame's pose in its parent, once: the solved edges, and what joins them to the LiDAR and the vehicle."""
    tree: dict[str, SE3] = {}
    for camera in calibrated.cameras:
        root, edge = calibrated.T_root_lidar(camera.lidar_frame), solved_edge(camera)
        if root is not None:
            tree[camera.lidar_frame] = root
            if camera.joint and edge.to_frame not in (root.to_frame, camera.lidar_frame):
                tree[edge.to_frame] = root @ camera.joint.T_parent_lidar.inverse()
        tree[edge.from_frame] = edge
        if camera.joint and edge.from_frame != camera.frame:
            tree[camera.frame] = camera.joint.T_child_camera
    return list(tree.values())
