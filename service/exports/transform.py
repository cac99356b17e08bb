"""A rigid transform between two named frames, and the ways in which formats write rotations."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from service.calibration_runs.transforms import Document, Floats, read, write


class Transform(NamedTuple):
    """``T_<to_frame>_<from_frame>``: p_to = R p_from + t. R (3, 3), t (3,) in metres."""

    to_frame: str
    from_frame: str
    R: Floats
    t: Floats

    @classmethod
    def of(cls, document: Document) -> Self:
        """A transform document, its rotation made exactly orthonormal."""
        return cls(document["to_frame"], document["from_frame"], *read(document))

    def inverse(self) -> Transform:
        """``T_<from_frame>_<to_frame>``."""
        return Transform(self.from_frame, self.to_frame, self.R.T, -self.R.T @ self.t)

    def after(self, first: Transform) -> Transform:
        """``T_a_c`` of ``T_a_b`` (this one) and ``T_b_c``."""
        return Transform(self.to_frame, first.from_frame, self.R @ first.R, self.R @ first.t + self.t)

    @property
    def matrix(self) -> Floats:
        """Homogeneous, (4, 4)."""
        return np.block([[self.R, self.t[:, None]], [np.array([[0.0, 0.0, 0.0, 1.0]])]])

    @property
    def quaternion_xyzw(self) -> list[float]:
        """Unit quaternion, scalar last and not negative."""
        return write("", "", self.R, self.t)["rotation"]["quaternion_xyzw"]

    @property
    def roll_pitch_yaw(self) -> list[float]:
        """Radians about the fixed axes x, y, z: R = Rz(yaw) Ry(pitch) Rx(roll)."""
        # At pitch = +-90 degrees one of the three is free; the stated order holds there too.
        zyx = write("", "", self.R, self.t)["rotation"]["euler"][0]
        return [float(angle) for angle in np.radians(zyx["angles_deg"])][::-1]


def numbers(values: Floats | list[float]) -> list[float]:
    """Numbers by rows, as Python's own: they are written so that reading gives the same bits. No negative zeros."""
    return [float(value) + 0.0 for value in np.ravel(values)]


def yaml_number(value: float) -> str:
    """YAML 1.1 takes ``1e-05`` for text: a number has a point."""
    text = repr(float(value) + 0.0)
    return text if "." in text else text.replace("e", ".0e")


def yaml_list(values: Floats | list[float]) -> str:
    """Numbers by rows, in brackets."""
    return f"[{', '.join(map(yaml_number, numbers(values)))}]"
