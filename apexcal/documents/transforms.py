"""Transform documents as people send them: both frames named, a rotation that is one, and metres.

``T_to_from`` maps points of ``from_frame`` into ``to_frame``: p_to = R p_from + t. The document is kept as it was
written; the workers compute with it.
"""

from __future__ import annotations

from math import hypot
from typing import Annotated, Literal

from pydantic import Field, model_validator

from apexcal.documents.base import Document, Magnitude, Name, Received

Vector = tuple[Magnitude, Magnitude, Magnitude]

# Published matrices carry four to six digits.
_ORTHONORMAL_TO = 1e-3
# A result says its rotation in every form; sent back, its matrix is taken.
_AS_RESULTS_SAY_IT = {"matrix", "quaternion_xyzw", "euler"}
_Farthest = Annotated[float, Field(allow_inf_nan=False, ge=-1000.0, le=1000.0)]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


class EulerAngles(Received):
    """R = Rz(a) Ry(b) Rx(g) for ``zyx``, R = Rx(a) Ry(b) Rz(g) for ``xyz_eq2``; degrees."""

    euler_order: Literal["zyx", "xyz_eq2"]
    angles_deg: Vector


class Matrix(Received):
    """Three rows of three numbers."""

    matrix: Annotated[tuple[Vector, Vector, Vector], Field(examples=[[[0, -1, 0], [0, 0, -1], [1, 0, 0]]])]

    @model_validator(mode="after")
    def _is_a_rotation(self) -> Matrix:
        a, b, c = self.matrix
        lengths = (_dot(a, a) - 1.0, _dot(b, b) - 1.0, _dot(c, c) - 1.0)
        if max(map(abs, (*lengths, _dot(a, b), _dot(b, c), _dot(c, a)))) > _ORTHONORMAL_TO:
            raise ValueError("the rows are not orthonormal: is it the 3 x 3 part alone, without scale?")
        if _dot(a, _cross(b, c)) < 0:
            raise ValueError("the matrix mirrors (determinant -1): is an axis flipped?")
        return self


class Quaternion(Received):
    """Scalar last."""

    quaternion_xyzw: tuple[Magnitude, Magnitude, Magnitude, Magnitude]

    @model_validator(mode="after")
    def _has_unit_length(self) -> Quaternion:
        if abs(hypot(*self.quaternion_xyzw) - 1.0) > _ORTHONORMAL_TO:
            raise ValueError("the quaternion has no unit length: is it in the order x, y, z, w?")
        return self


class Transform(Received):
    """``T_<to_frame>_<from_frame>``."""

    to_frame: Name
    from_frame: Name
    rotation: EulerAngles | Matrix | Quaternion
    translation_m: tuple[_Farthest, _Farthest, _Farthest]

    @model_validator(mode="before")
    @classmethod
    def _names_one_rotation(cls, data: object) -> object:
        # Without this, a union answers with the complaints of all three forms at once.
        forms = {"euler_order", "angles_deg", "matrix", "quaternion_xyzw"}
        if not isinstance(data, dict):
            return data
        rotation = data.get("rotation")
        if isinstance(rotation, dict):
            if set(rotation) == _AS_RESULTS_SAY_IT:
                return {**data, "rotation": {"matrix": rotation["matrix"]}}
            named = forms & set(rotation)
            if named not in ({"matrix"}, {"quaternion_xyzw"}, {"euler_order", "angles_deg"}):
                raise ValueError(
                    "rotation takes exactly one form: euler_order with angles_deg (zyx or xyz_eq2: the order is "
                    "never assumed), or matrix, or quaternion_xyzw"
                )
        return data


def check_frames(transform: Transform, name: str, to_frame: str, from_frame: str) -> None:
    """Raises ValueError unless the transform leads from ``from_frame`` into ``to_frame``."""
    if (transform.to_frame, transform.from_frame) == (to_frame, from_frame):
        return
    swapped = (transform.to_frame, transform.from_frame) == (from_frame, to_frame)
    raise ValueError(
        f"{name} maps points of {from_frame!r} into {to_frame!r} (from_frame, to_frame), and this one says "
        f"from_frame {transform.from_frame!r}, to_frame {transform.to_frame!r}"
        + (": it is inverted" if swapped else "")
    )


class SolvedAngles(Document):
    """A rotation as Euler angles, degrees; the order as :class:`EulerAngles` has it."""

    euler_order: Literal["zyx", "xyz_eq2"]
    angles_deg: list[float]


class SolvedRotation(Document):
    """A rotation in every form; the quaternion's scalar is last."""

    matrix: list[list[float]]
    quaternion_xyzw: list[float]
    euler: list[SolvedAngles]


class SolvedTransform(Document):
    """``T_<to_frame>_<from_frame>`` as results say it; metres."""

    to_frame: str
    from_frame: str
    rotation: SolvedRotation
    translation_m: list[float]
