"""What a vehicle's drivers and its description state: CameraInfo of each camera, and the tree of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.camera_models import CAMERA_MODELS
from workers.geometry.rotations import euler_from_rotation, rotation_from_vector
from workers.geometry.transforms import RigidTransform
from workers.simulation.camera import LIDAR_FRAME, Camera, camera_frame

BASE_FRAME = "base_link"
# The LiDAR stands on the roof, above the front axle. Metres.
_LIDAR_X_M = 1.2
# A stereo camera's rectification: how far it turns, how its focal length and its centre differ from the lens's.
_TURN_DEG = 1.2
_FOCAL_SHARE = 0.92
_CENTRE_SIGMA_PX = 6.0
_OPTICAL_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True, slots=True)
class DriverInfo:
    """The fields of a CameraInfo: D, K (3, 3), R (3, 3), P (3, 4)."""

    distortion_model: str
    D: NDArray[np.float64]
    K: NDArray[np.float64]
    R: NDArray[np.float64]
    P: NDArray[np.float64]

    def document(self) -> dict[str, Any]:
        """Plain data, matrices by rows."""
        matrices = {name: getattr(self, name).reshape(-1).tolist() for name in "DKRP"}
        return {"distortion_model": self.distortion_model, **matrices}


def driver_info(camera: Camera, first: Camera, seed: int, number: int) -> DriverInfo:
    """CameraInfo as a stereo driver publishes it for raw and rectified images alike.

    K and D are the lens of ``camera``. R turns 1.2 degrees about any axis. P has another focal length and centre, and
    P[0, 3] = -f b, where b is how far right of the ``first`` camera of the rig this one stands.
    """
    random = np.random.default_rng([seed, 11, number])
    axis = random.normal(size=3)
    R = rotation_from_vector(np.deg2rad(_TURN_DEG) * axis / np.linalg.norm(axis))
    lens, model = camera.intrinsics, CAMERA_MODELS[camera.model]
    f, centre = _FOCAL_SHARE * lens["f_x"], random.normal((lens["c_x"], lens["c_y"]), _CENTRE_SIGMA_PX)
    b = (R @ camera.T_camera_lidar.R @ (camera.centre() - first.centre()))[0]
    K = np.array([[lens["f_x"], 0.0, lens["c_x"]], [0.0, lens["f_y"], lens["c_y"]], [0.0, 0.0, 1.0]])
    P = np.array([[f, 0.0, centre[0], -f * b], [0.0, f, centre[1], 0.0], [0.0, 0.0, 1.0, 0.0]])
    assert model.written_as is not None
    D = np.array([lens[name] for name in model.distortion] or [0.0] * 5)
    return DriverInfo(model.written_as.camera_info, D, K, R, P)


def rectified(camera: Camera, info: DriverInfo) -> Camera:
    """The camera that would draw the rectified images: a pinhole with P[:, :3], turned by R."""
    lens = {"f_x": info.P[0, 0], "f_y": info.P[1, 1], "c_x": info.P[0, 2], "c_y": info.P[1, 2]}
    mount = camera.T_camera_lidar
    turn = RigidTransform(f"{mount.to_frame}_rectified", mount.to_frame, info.R, np.zeros(3))
    return Camera("pinhole", {name: float(value) for name, value in lens.items()}, camera.image_size, turn @ mount)


def frame_tree(ground_z: float, mounts: Sequence[tuple[str, RigidTransform]]) -> list[RigidTransform]:
    """T_parent_child of each frame: LiDAR and camera bodies (x forward) in ``base_link``, optical frames in bodies.

    Args:
        ground_z: the ground in the LiDAR frame, metres.
        mounts: each camera's name and T_camera_lidar.
    """
    T_base_lidar = RigidTransform(BASE_FRAME, LIDAR_FRAME, np.eye(3), np.array([_LIDAR_X_M, 0.0, -ground_z]))
    poses = [T_base_lidar]
    for name, T_camera_lidar in mounts:
        body = RigidTransform(camera_frame(name), f"camera_{name}_link", _OPTICAL_BODY, np.zeros(3))
        poses += [T_base_lidar @ T_camera_lidar.inverse() @ body, body.inverse()]
    return poses


def urdf(poses: Sequence[RigidTransform]) -> str:
    """The tree as a URDF: a link for each frame, a fixed joint for each pose, named ``<child>_joint``."""
    frames = dict.fromkeys([*(pose.to_frame for pose in poses), *(pose.from_frame for pose in poses)])
    lines = ['<?xml version="1.0"?>', '<robot name="simulated">']
    lines += [f"  <link name={quoteattr(frame)}/>" for frame in frames]
    for pose in poses:
        rpy = euler_from_rotation(pose.R)[::-1]  # R = Rz(yaw) Ry(pitch) Rx(roll)
        xyz, turn = (" ".join(repr(float(value)) for value in values) for values in (pose.t, rpy))
        lines += [
            f'  <joint name={quoteattr(f"{pose.from_frame}_joint")} type="fixed">',
            f"    <parent link={quoteattr(pose.to_frame)}/>",
            f"    <child link={quoteattr(pose.from_frame)}/>",
            f'    <origin xyz="{xyz}" rpy="{turn}"/>',
            "  </joint>",
        ]
    return "\n".join([*lines, "</robot>", ""])
