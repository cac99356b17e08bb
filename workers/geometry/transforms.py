"""Rigid transforms that know both their frames."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from workers.geometry.errors import GeometryError
from workers.geometry.rotations import (
    EULER_ORDERS,
    check_rotation,
    euler_from_rotation,
    parse_euler_order,
    quaternion_from_rotation,
    rotation_from_euler,
    rotation_from_quaternion,
)


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """T_to_from: maps points of `from_frame` into `to_frame`, p_to = R p_from + t.

    R float64 (3, 3), right-handed and orthonormal; t float64 (3,) in metres. Both are read-only.
    """

    to_frame: str
    from_frame: str
    R: NDArray[np.float64] = field(repr=False)
    t: NDArray[np.float64]

    def __post_init__(self) -> None:
        R = check_rotation(self.R).copy()
        t = np.array(self.t, dtype=np.float64)
        if t.shape != (3,) or not np.all(np.isfinite(t)):
            raise GeometryError("bad_translation", "A translation is three finite numbers in metres.", "")
        if not self.to_frame or not self.from_frame:
            raise GeometryError("bad_frame", "A transform names both its frames.", "Give to_frame and from_frame.")
        R.setflags(write=False)
        t.setflags(write=False)
        object.__setattr__(self, "R", R)
        object.__setattr__(self, "t", t)

    @staticmethod
    def identity(to_frame: str, from_frame: str) -> "RigidTransform":
        """The transform between two frames that coincide."""
        return RigidTransform(to_frame, from_frame, np.eye(3), np.zeros(3))

    def __matmul__(self, other: "RigidTransform") -> "RigidTransform":
        """T_a_b @ T_b_c = T_a_c. Raises GeometryError `frames_do_not_meet` where the inner frames differ."""
        if self.from_frame != other.to_frame:
            raise GeometryError(
                "frames_do_not_meet",
                f"T_{self.to_frame}_{self.from_frame} cannot follow T_{other.to_frame}_{other.from_frame}.",
                f"The frames {self.from_frame!r} and {other.to_frame!r} differ; is one of them inverted?",
            )
        return RigidTransform(self.to_frame, other.from_frame, self.R @ other.R, self.R @ other.t + self.t)

    def inverse(self) -> "RigidTransform":
        """T_from_to."""
        return RigidTransform(self.from_frame, self.to_frame, self.R.T, -self.R.T @ self.t)

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """Points (..., 3) in metres of `from_frame`, returned in `to_frame`."""
        return np.asarray(points, dtype=np.float64) @ self.R.T + self.t


def from_document(document: Mapping[str, Any]) -> RigidTransform:
    """The transform of its JSON form.

    {"to_frame", "from_frame", "rotation": {"euler_order", "angles_deg"} or {"matrix"} or {"quaternion_xyzw"},
    "translation_m"}. Of several rotations the matrix is read first, then the quaternion, then the angles (one
    order, or a list `euler` of both, as `to_document` writes them). A missing translation is zero.
    Raises GeometryError.
    """
    try:
        rotation = cast("Mapping[str, Any]", document["rotation"])
        return RigidTransform(
            str(document["to_frame"]),
            str(document["from_frame"]),
            _rotation_of(rotation),
            np.asarray(document.get("translation_m", (0.0, 0.0, 0.0)), dtype=np.float64),
        )
    except GeometryError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise GeometryError(
            "bad_transform",
            f"The transform cannot be read: {type(error).__name__} {error}.",
            'It is {"to_frame", "from_frame", "rotation": {"euler_order", "angles_deg"} or {"matrix"} or '
            '{"quaternion_xyzw"}, "translation_m": [x, y, z]}.',
        ) from error


def _rotation_of(rotation: Mapping[str, Any]) -> NDArray[np.float64]:
    if "matrix" in rotation:
        return check_rotation(rotation["matrix"])
    if "quaternion_xyzw" in rotation:
        return rotation_from_quaternion(rotation["quaternion_xyzw"])
    named: Mapping[str, Any] = rotation
    if "angles_deg" not in rotation and "euler" in rotation:
        named = cast("Sequence[Mapping[str, Any]]", rotation["euler"])[0]
    # Angles without their order are the field's oldest trap: no default here.
    return rotation_from_euler(np.radians(named["angles_deg"]), parse_euler_order(named["euler_order"]))


def to_document(transform: RigidTransform) -> dict[str, Any]:
    """The JSON form, with the rotation as matrix, quaternion and Euler angles in both orders, all named.

    The floats survive JSON exactly; `from_document` gives back the same matrix and translation to the bit.
    """
    return {
        "to_frame": transform.to_frame,
        "from_frame": transform.from_frame,
        "rotation": {
            "matrix": transform.R.tolist(),
            "quaternion_xyzw": quaternion_from_rotation(transform.R).tolist(),
            "euler": [
                {
                    "euler_order": order,
                    "angles_deg": np.degrees(euler_from_rotation(transform.R, order)).tolist(),
                }
                for order in EULER_ORDERS
            ],
        },
        "translation_m": transform.t.tolist(),
    }
