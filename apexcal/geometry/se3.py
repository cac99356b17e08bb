"""Rigid transforms that know both their frames: the group SE(3).

Source: Barfoot, State Estimation for Robotics, 2017, chapter 7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.errors import GeometryError
from apexcal.documents.transforms import SolvedTransform, Transform
from apexcal.geometry.rotations import (
    EULER_ORDERS,
    check_rotation,
    euler_from_rotation,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SE3:
    """T_to_from: maps points of `from_frame` into `to_frame`, p_to = R p_from + t.

    R float64 (3, 3), right-handed and orthonormal, the digits of published matrices repaired; t float64 (3,) in
    metres. Both are read-only. Raises GeometryError where they are no transform.
    """

    to_frame: str
    from_frame: str
    R: Floats = field(repr=False, default_factory=lambda: np.eye(3))
    t: Floats = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        R, t = check_rotation(self.R).copy(), np.array(self.t, dtype=np.float64)
        if t.shape != (3,) or not np.all(np.isfinite(t)):
            raise GeometryError("bad_translation", "A translation is three finite numbers in metres.", "")
        R.setflags(write=False)
        t.setflags(write=False)
        object.__setattr__(self, "R", R)
        object.__setattr__(self, "t", t)

    def adjoint(self) -> Floats:
        """Ad (6, 6), which carries twists of `from_frame` into `to_frame`: T exp(x) T^-1 = exp(Ad x).

        A twist is a turn in radians, then a shift in metres. Barfoot 2017, eq. 7.45: [[R, 0], [[t]x R, R]].
        """
        return np.block([[self.R, np.zeros((3, 3))], [_cross(self.t) @ self.R, self.R]])

    def __matmul__(self, other: SE3) -> SE3:
        """T_a_b @ T_b_c = T_a_c. Raises GeometryError `frames_do_not_meet` where the inner frames differ."""
        if self.from_frame != other.to_frame:
            raise GeometryError(
                "frames_do_not_meet",
                f"T_{self.to_frame}_{self.from_frame} cannot follow T_{other.to_frame}_{other.from_frame}.",
                f"The frames {self.from_frame!r} and {other.to_frame!r} differ; is one of them inverted?",
            )
        return SE3(self.to_frame, other.from_frame, self.R @ other.R, self.R @ other.t + self.t)

    def inverse(self) -> SE3:
        """Return T_from_to."""
        return SE3(self.from_frame, self.to_frame, self.R.T, -self.R.T @ self.t)

    def apply(self, points: ArrayLike) -> Floats:
        """Return points (..., 3), metres, of `from_frame` in `to_frame`."""
        return np.asarray(points, dtype=np.float64) @ self.R.T + self.t

    @property
    def matrix(self) -> Floats:
        """Return the homogeneous matrix (4, 4)."""
        return np.block([[self.R, self.t[:, None]], [np.array([[0.0, 0.0, 0.0, 1.0]])]])

    @property
    def quaternion_xyzw(self) -> list[float]:
        """Unit quaternion, scalar last and not negative."""
        return quaternion_from_rotation(self.R).tolist()

    @property
    def roll_pitch_yaw(self) -> list[float]:
        """Radians about the fixed axes x, y, z: R = Rz(yaw) Ry(pitch) Rx(roll)."""
        return euler_from_rotation(self.R).tolist()[::-1]


def from_document(document: Mapping[str, Any] | Transform | SolvedTransform) -> SE3:
    """Return the transform of a document of a request or result. If it has several rotations, the matrix counts."""
    document = document if isinstance(document, Mapping) else document.model_dump()
    rotation: Mapping[str, Any] = document["rotation"]
    if "matrix" in rotation:
        R = rotation["matrix"]
    elif "quaternion_xyzw" in rotation:
        R = rotation_from_quaternion(rotation["quaternion_xyzw"])
    else:
        R = rotation_from_euler(np.radians(rotation["angles_deg"]), rotation["euler_order"])
    return SE3(document["to_frame"], document["from_frame"], R, document["translation_m"])


def to_document(transform: SE3) -> dict[str, Any]:
    """Return the JSON form, with the rotation as matrix, quaternion and Euler angles in both orders, all named.

    The floats survive JSON exactly; `from_document` gives back the same matrix and translation to the bit.
    """
    return {
        "to_frame": transform.to_frame,
        "from_frame": transform.from_frame,
        "rotation": {
            "matrix": transform.R.tolist(),
            "quaternion_xyzw": transform.quaternion_xyzw,
            "euler": [
                {"euler_order": order, "angles_deg": np.degrees(euler_from_rotation(transform.R, order)).tolist()}
                for order in EULER_ORDERS
            ],
        },
        "translation_m": transform.t.tolist(),
    }


def _cross(v: Floats) -> Floats:
    """[v]x (3, 3), so that [v]x w = v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
