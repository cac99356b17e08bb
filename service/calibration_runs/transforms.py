"""Composes the transforms of a rig and a result into ``T_vehicle_camera``.

The conventions are those of ``workers/geometry``: R = Rz(alpha) Ry(beta) Rx(gamma) for ``zyx``, R = Rx(alpha)
Ry(beta) Rz(gamma) for ``xyz_eq2``, quaternions scalar last. A contract test compares both sides.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Document = dict[str, Any]
# Cosine of beta below which the other two angles act alike.
_SINGULAR = 1e-9
# Radians within which the sums of two triples count as equal.
_SAME = 1e-9


def T_vehicle_camera(T_vehicle_lidar: Document, T_camera_lidar: Document) -> Document:  # noqa: N802 - a transform
    """T_vehicle_lidar @ inverse(T_camera_lidar), with both its frames named. Both documents share the LiDAR frame."""
    R_vehicle_lidar, t_vehicle_lidar = read(T_vehicle_lidar)
    R_camera_lidar, t_camera_lidar = read(T_camera_lidar)
    R = R_vehicle_lidar @ R_camera_lidar.T
    t = t_vehicle_lidar - R @ t_camera_lidar
    return write(T_vehicle_lidar["to_frame"], T_camera_lidar["to_frame"], R, t)


def T_parent_child(joint: Document, T_camera_lidar: Document) -> Document:  # noqa: N802 - a transform
    """The child's pose in its parent: T_parent_lidar @ inverse(T_camera_lidar) @ inverse(T_child_camera)."""
    T_parent_camera = T_vehicle_camera(joint["T_parent_lidar"], T_camera_lidar)
    return T_vehicle_camera(T_parent_camera, joint["T_child_camera"])


def read(document: Document) -> tuple[Floats, Floats]:
    """R (3, 3) and t (3,) in metres of a transform document; R is made exactly orthonormal."""
    rotation = document["rotation"]
    if "matrix" in rotation:
        R = np.array(rotation["matrix"], np.float64)
    elif "quaternion_xyzw" in rotation:
        R = _from_quaternion(np.array(rotation["quaternion_xyzw"], np.float64))
    else:
        R = _from_euler(np.radians(rotation["angles_deg"]), rotation["euler_order"])
    # Published matrices carry few digits: the nearest rotation (Arun 1987), so that an inverse is a transpose.
    U, _, Vt = np.linalg.svd(R)
    return U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt, np.array(document["translation_m"], np.float64)


def write(to_frame: str, from_frame: str, R: Floats, t: Floats) -> Document:
    """The document with the rotation as matrix, quaternion and Euler angles in both orders, all named."""
    return {
        "to_frame": to_frame,
        "from_frame": from_frame,
        "rotation": {
            "matrix": R.tolist(),
            "quaternion_xyzw": _quaternion(R).tolist(),
            "euler": [
                {"euler_order": order, "angles_deg": np.degrees(_euler(R, order)).tolist()}
                for order in ("zyx", "xyz_eq2")
            ],
        },
        "translation_m": t.tolist(),
    }


def _axis_rotation(axis: int, angle: float) -> Floats:
    first, second = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[first, first] = R[second, second] = np.cos(angle)
    R[second, first] = np.sin(angle)
    R[first, second] = -R[second, first]
    return R


def _from_euler(angles: Floats, order: str) -> Floats:
    axes = (2, 1, 0) if order == "zyx" else (0, 1, 2)
    first, second, third = (_axis_rotation(axis, float(angle)) for axis, angle in zip(axes, angles, strict=True))
    return first @ second @ third


def _euler(R: Floats, order: str) -> Floats:
    """Of the two triples, in radians, that whose absolute values sum to less; at the singular point the last is 0."""
    if order == "zyx":
        across = np.hypot(R[0, 0], R[1, 0])
        beta = np.arctan2(-R[2, 0], across)
        if across < _SINGULAR:
            return np.array([np.arctan2(-R[0, 1], R[1, 1]), beta, 0.0])
        first = np.array([np.arctan2(R[1, 0], R[0, 0]), beta, np.arctan2(R[2, 1], R[2, 2])])
    else:
        across = np.hypot(R[0, 0], R[0, 1])
        beta = np.arctan2(R[0, 2], across)
        if across < _SINGULAR:
            return np.array([np.arctan2(R[2, 1], R[1, 1]), beta, 0.0])
        first = np.array([np.arctan2(-R[1, 2], R[2, 2]), beta, np.arctan2(-R[0, 1], R[0, 0])])
    turned = first * (1.0, -1.0, 1.0) + np.pi
    second = np.arctan2(np.sin(turned), np.cos(turned))
    return second if np.abs(second).sum() < np.abs(first).sum() - _SAME else first


def _from_quaternion(q: Floats) -> Floats:
    x, y, z, w = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _quaternion(R: Floats) -> Floats:
    """Unit quaternion x y z w with w >= 0: an eigenvector of Bar-Itzhack's matrix (2000), good everywhere."""
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], np.trace(R)],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    return -q if q[3] < 0 else q
