"""Statements of a vehicle's drivers and of its description: CameraInfo of each camera, and the tree of frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from apexcal.documents.camera_models import CAMERA_MODELS
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, euler_from_rotation, rotation_from_vector
from apexcal.geometry.se3 import SE3
from workers.readers.copying.edits import CameraEdit
from workers.simulation.camera import LIDAR_FRAME, SimulatedCamera

# The LiDAR stands on the roof, this far before the origin of base_link. Metres.
_LIDAR_X_M = 1.2
# A stereo camera's rectification: how far it turns, how its focal length and its centre differ from the lens's.
_TURN_DEG = 1.2
_FOCAL_SHARE = 0.92
_CENTRE_SIGMA_PX = 6.0


def camera_info(name: str, camera: SimulatedCamera, first: SimulatedCamera, seed: int, number: int) -> CameraEdit:
    """CameraInfo as a stereo driver publishes it for raw and rectified images alike.

    K and D are the lens of ``camera``. R turns 1.2 degrees about any axis. P has another focal length and centre, and
    P[0, 3] = -f b, where b is how far right of the ``first`` camera of the rig this one stands, metres.
    """
    random = np.random.default_rng([seed, 11, number])
    axis = random.normal(size=3)
    R = rotation_from_vector(np.deg2rad(_TURN_DEG) * axis / np.linalg.norm(axis))
    lens, model = camera.intrinsics, CAMERA_MODELS[camera.model]
    f, (c_x, c_y) = _FOCAL_SHARE * lens["f_x"], random.normal((lens["c_x"], lens["c_y"]), _CENTRE_SIGMA_PX)
    b = float((R @ camera.T_camera_lidar.R @ (camera.centre() - first.centre()))[0])
    K = (lens["f_x"], 0.0, lens["c_x"], 0.0, lens["f_y"], lens["c_y"], 0.0, 0.0, 1.0)
    P = (f, 0.0, c_x, -f * b, 0.0, f, c_y, 0.0, 0.0, 0.0, 1.0, 0.0)
    D = tuple(lens[name] for name in model.distortion) or (0.0,) * 5
    stated = "" if model.written_as is None else model.written_as.camera_info
    frame, size = camera.T_camera_lidar.to_frame, camera.image_size
    return CameraEdit(name, "", frame, *size, stated, K, D, R=tuple(R.reshape(-1)), P=P)


def rectified(camera: SimulatedCamera, info: CameraEdit) -> SimulatedCamera:
    """The camera that would draw the rectified images: a pinhole with P[:, :3], turned by R."""
    lens = {"f_x": info.P[0], "f_y": info.P[5], "c_x": info.P[2], "c_y": info.P[6]}
    turn = SE3(f"{info.frame_id}_rectified", info.frame_id, np.reshape(info.R, (3, 3)), np.zeros(3))
    return SimulatedCamera("pinhole", lens, camera.image_size, turn @ camera.T_camera_lidar)


def frame_tree(ground_z: float, mounts: Sequence[SE3]) -> list[SE3]:
    """T_parent_child of each frame: LiDAR and cameras' bodies (x forward) in base_link, optical frames in bodies.

    Args:
        ground_z: the ground in the LiDAR frame, metres.
        mounts: T_camera_lidar of each camera.
    """
    T_base_lidar = SE3("base_link", LIDAR_FRAME, np.eye(3), np.array([_LIDAR_X_M, 0.0, -ground_z]))
    poses = [T_base_lidar]
    for mount in mounts:
        name = mount.to_frame.replace("_optical", "_link")
        body = SE3(mount.to_frame, name, FORWARD_LIDAR_TO_OPTICAL)
        poses += [T_base_lidar @ mount.inverse() @ body, body.inverse()]
    return poses


def urdf(poses: Sequence[SE3]) -> str:
    """The tree as a URDF: a link for each frame, and a fixed joint ``<child>_joint`` for each pose."""
    frames = dict.fromkeys(frame for pose in poses for frame in (pose.to_frame, pose.from_frame))
    lines = ['<?xml version="1.0"?>', '<robot name="simulated">', *(f'  <link name="{frame}"/>' for frame in frames)]
    for pose in poses:
        # R = Rz(yaw) Ry(pitch) Rx(roll)
        values = (pose.t, euler_from_rotation(pose.R)[::-1])
        xyz, rpy = (" ".join(map(repr, vector.tolist())) for vector in values)
        parent, child = f'<parent link="{pose.to_frame}"/>', f'<child link="{pose.from_frame}"/>'
        lines.append(f'  <joint name="{pose.from_frame}_joint" type="fixed">')
        lines.append(f'    {parent}{child}<origin xyz="{xyz}" rpy="{rpy}"/>\n  </joint>')
    return "\n".join([*lines, "</robot>", ""])
