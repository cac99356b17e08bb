"""Mounts in documents of any program, where a name or the format says which way a transform leads.

``T_a_b`` maps points of b into a: so Kalibr, OpenVINS (``T_imu_cam``), ORB-SLAM3 (``T_c1_c2``) and
direct_visual_lidar_calibration; so does ``a_T_b`` (VINS: ``body_T_cam0``). ``a_to_b`` maps points of a into b: so
KITTI and KITTI-360 (``calib_cam_to_velo.txt``). A ROS transform is the pose of ``child_frame_id`` in
``header.frame_id`` (tf2; Apollo's extrinsics). ``Rcl``, ``Pcl`` map LiDAR points into the camera (FAST-LIVO2,
FAST-Calib), and Autoware's ``CameraExtrinsicMat`` camera points into the LiDAR: its ``points_image.cpp`` inverts it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from apexcal.documents.errors import GeometryError
from apexcal.documents.name_words import words
from apexcal.geometry.rotations import rotation_from_quaternion
from apexcal.geometry.se3 import SE3, Floats
from service.imports.contents import LIDAR, Contents, FileCamera, matrix, refused, transform
from service.imports.members import Block, blocks, member, scalar, vector

_LIDARS: Final = frozenset(
    ("lidar", "velo", "velodyne", "laser", "livox", "pandar", "hesai", "ouster", "rslidar", "l")
)
_CAMERAS: Final = frozenset(("cam", "camera", "image", "img", "optical", "c"))
_OTHERS: Final = frozenset(
    (
        *("imu", "ins", "gps", "novatel", "body", "base", "ego", "vehicle"),
        *("world", "map", "odom", "radar", "pose", "sick"),
    )
)
_UNDIRECTED: Final = ("T", "rvec", "tvec", "extrinsic", "extrinsics", "extrinsic_parameters", "ExtrinsicMat")
# A name is split at each of its underscores, so longer names would take long.
_LONGEST_NAME: Final = 100
_OURS: Final = "T_camera_lidar"
AS_MOUNT: Final = (
    "Give the transform (the member, or a file of the bare numbers) the name T_camera_lidar if it maps LiDAR points "
    "into the camera, or T_lidar_camera if it maps camera points into the LiDAR."
)


class Pose(NamedTuple):
    """R (3, 3) and t (3,), float64, metres."""

    R: Floats
    t: Floats


def sends_into_camera(name: str) -> bool | None:
    """Return whether a transform of this name maps LiDAR points into the camera; None if the name does not tell."""
    if len(name) > _LONGEST_NAME:
        return None
    if name == "CameraExtrinsicMat":
        return False
    if match := re.fullmatch(r"T_?([cl])_?([cl])", name):
        return match[1] == "c" if match[1] != match[2] else None
    if (match := re.fullmatch(r"(.+?)_?(?:to|2)_?(.+)", name, re.IGNORECASE)) and _ends(match[2], match[1]):
        return _ends(match[2], match[1]) == "camera"
    parts = re.sub(r"^T(?=[_A-Z])|_T(?=_)", "", name).strip("_").split("_")
    ends = {_ends("_".join(parts[:at]), "_".join(parts[at:])) for at in range(1, len(parts))} - {None}
    directed = bool(re.match(r"T[_A-Z]|\w+_T_", name))
    return ends == {"camera"} if directed and len(ends) == 1 else None


def is_of_vehicle(name: str) -> bool:
    """Return whether a name has a word for a frame that is neither a LiDAR's nor a camera's."""
    return bool(words(name) & _OTHERS)


def _ends(to: str, of: str) -> str | None:
    """Return the end of a transform between both sensors: ``camera`` or ``lidar``; None for any other transform."""
    into, source = _role(to), _role(of)
    return into if {into, source} == {"camera", LIDAR} else None


def _role(name: str) -> str | None:
    own = words(name)
    roles = [role for role, names in (("camera", _CAMERAS), (LIDAR, _LIDARS), ("", _OTHERS)) if own & names]
    return roles[0] if len(roles) == 1 and roles[0] else None


def with_mounts(contents: Contents, document: Block) -> Contents:
    """Return a file's contents with the mounts that its names or its ROS transforms state.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    mounts: dict[str, SE3] = {}
    notes = list(contents.notes)
    undirected: list[str] = []
    for _, block in blocks(document):
        if {"Rcl", "Pcl"} <= set(block):
            mounts["Rcl, Pcl"] = transform("camera", LIDAR, *_three_and_three(block["Rcl"], block["Pcl"]))
        if stamped := _of_ros(block):
            mounts[stamped.to_frame] = stamped
        for name, value in block.items():
            into_camera, pose = sends_into_camera(name), _pose(value)
            if pose is not None and into_camera is not None:
                if np.array_equal(pose.R, np.eye(3)) and not pose.t.any():
                    notes.append(f"{name} is left out: it is the identity, as files have it before a calibration.")
                    continue
                mounts[name] = _mount(name, into_camera, pose, document)
                if name != _OURS:
                    points, end = ("LiDAR", "camera") if into_camera else ("camera", "LiDAR")
                    notes.append(f"{name} maps {points} points into the {end}'s frame, as its name says.")
            elif (
                name in _UNDIRECTED or (pose and len(vector(value) or ()) == 16) or _is_turn_beside_shift(name, block)
            ):
                undirected.append(name)
    if undirected:
        notes.append(
            f"{', '.join(dict.fromkeys(undirected))}: no direction between LiDAR and camera is stated, so it was "
            "left out."
        )
    return Contents(_joined(contents.cameras, mounts, notes), contents.camera_transforms, notes)


def is_pose(document: Block) -> bool:
    """Return whether a whole document is one transform. The file's name may state its direction."""
    return _pose(document) is not None


def _is_turn_beside_shift(name: str, block: Block) -> bool:
    """Return whether a member is a rotation beside a translation: R3LIVE's ``camera_ext_R``, ``camera_ext_t``."""
    turn = np.reshape(numbers, (3, 3)) if len(numbers := vector(block[name]) or ()) == 9 else np.zeros((3, 3))
    is_turn = np.allclose(turn @ turn.T, np.eye(3), atol=1e-2) and name not in ("Rcl", "R")
    shifts = (other for other in block if other[:-1] == name[:-1] and len(vector(block[other]) or ()) == 3)
    return bool(is_turn) and any(shifts)


def _joined(cameras: Sequence[FileCamera], mounts: Mapping[str, SE3], notes: list[str]) -> list[FileCamera]:
    """Give each camera its mount: the mount whose name holds the camera's, or the only mount to the only camera."""
    if not cameras:
        names = ["camera"] if len(mounts) == 1 else list(mounts)
        return [FileCamera(name[:200], T_camera_lidar=T) for name, T in zip(names, mounts.values(), strict=True)]
    joined: list[FileCamera] = []
    rest = dict(mounts)
    for camera in cameras:
        of = [name for name in rest if len(cameras) == len(mounts) == 1 or words(camera.name) <= words(name)]
        joined.append(replace(camera, T_camera_lidar=rest.pop(of[0])) if len(of) == 1 else camera)
    if rest:
        notes.append(
            f"{', '.join(rest)} is left out: it names none of the cameras {', '.join(c.name for c in cameras)}."
        )
    return joined


def _mount(name: str, into_camera: bool, pose: Pose, document: Block) -> SE3:
    if not into_camera:
        return transform(LIDAR, "camera", *pose).inverse()
    frames = [document.get(key) if name == _OURS else None for key in ("camera_frame", "lidar_frame")]
    return transform(str(frames[0] or "camera")[:200], str(frames[1] or LIDAR)[:200], *pose)


def _of_ros(block: Block) -> SE3 | None:
    """Return T_camera_lidar of a TransformStamped between a LiDAR's frame and a camera's; None for others.

    A frame whose name names no sensor and no part of the vehicle counts as the camera's.
    """
    header, child = block.get("header"), block.get("child_frame_id")
    parent = header.get("frame_id") if isinstance(header, dict) else block.get("frame_id")
    pose = _pose(block.get("transform"))
    if pose is None or not isinstance(parent, str) or not isinstance(child, str):
        return None
    roles = [_role(name) or ("camera" if not words(name) & (_OTHERS | _LIDARS) else "") for name in (parent, child)]
    if set(roles) != {"camera", LIDAR}:
        return None
    T = transform(parent[:200], child[:200], *pose)
    return T if roles[0] == "camera" else T.inverse()


def _pose(value: Any) -> Pose | None:
    """A transform of 12 or 16 numbers by rows, or of a rotation and a translation; None for anything else."""
    numbers = vector(value)
    if numbers is not None:
        if len(numbers) not in (12, 16) or (len(numbers) == 16 and numbers[12:] != [0.0, 0.0, 0.0, 1.0]):
            return None
        T = np.reshape(numbers[:12], (3, 4))
        return Pose(T[:, :3], T[:, 3])
    if not isinstance(value, dict):
        return None
    turn, shift = member(value, ("rotation", "r")), member(value, ("translation", "t"))
    if isinstance(shift, dict):
        shift = [shift.get(axis) for axis in "xyz"]
    if isinstance(turn, dict) and set("xyzw") <= set(turn) and len(vector(shift) or ()) == 3:
        quaternion = [scalar(turn[axis]) or 0.0 for axis in "xyzw"]
        try:
            return Pose(rotation_from_quaternion(quaternion), np.array(vector(shift)))
        except GeometryError as error:
            raise refused(f"A rotation is no quaternion. {error.message}", error.hint) from None
    sizes = len(vector(turn) or ()), len(vector(shift) or ())
    return _three_and_three(turn, shift) if sizes == (9, 3) else None


def _three_and_three(turn: Any, shift: Any) -> Pose:
    return Pose(matrix("The rotation", turn, 3, 3), matrix("The translation", shift, 3))
