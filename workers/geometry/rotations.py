# pyright: reportMissingTypeStubs=false
"""Rotations: Euler angles in both orders, rotation vectors, and their compiled forms for the hot loops."""

from math import cos, sin, sqrt
from typing import Final, Literal, get_args

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from workers.geometry.errors import GeometryError

EulerOrder = Literal["zyx", "xyz_eq2"]
EULER_ORDERS: Final[tuple[EulerOrder, ...]] = get_args(EulerOrder)

# scipy's capital letters are intrinsic rotations, so "ZYX" is Rz(first) Ry(second) Rx(third).
_SCIPY_SEQUENCE: Final[dict[EulerOrder, str]] = {"zyx": "ZYX", "xyz_eq2": "XYZ"}

FORWARD_LIDAR_TO_OPTICAL: Final[NDArray[np.float64]] = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""R_camera_lidar of a level camera that looks along x of a LiDAR with x forward, y left, z up."""

Rows = tuple[float, float, float, float, float, float, float, float, float]


def rotation_from_euler(angles: ArrayLike, order: EulerOrder = "zyx") -> NDArray[np.float64]:
    """The matrix (3, 3) of (alpha, beta, gamma) in radians.

    `zyx`: R = Rz(alpha) Ry(beta) Rx(gamma), as the paper's released toolbox computes it.
    `xyz_eq2`: R = Rx(alpha) Ry(beta) Rz(gamma), as the paper's equation 2 prints it.
    """
    return Rotation.from_euler(_SCIPY_SEQUENCE[parse_euler_order(order)], _vector(angles)).as_matrix()


def euler_from_rotation(R: ArrayLike, order: EulerOrder = "zyx") -> NDArray[np.float64]:
    """(alpha, beta, gamma) in radians, shape (3,), of a rotation matrix (3, 3).

    Every rotation has two such triples; the one whose absolute values sum to less is given, so that a camera
    tilted 15 degrees down reads (90, -105, 0) degrees and lies in the paper's box, not (-90, -75, 180).
    At the singular point (|beta| = pi/2) alpha and gamma act alike; gamma is 0 there and alpha carries the sum.
    """
    rotation = Rotation.from_matrix(check_rotation(R))
    first = rotation.as_euler(_SCIPY_SEQUENCE[parse_euler_order(order)], suppress_warnings=True)
    turned = first * (1.0, -1.0, 1.0) + np.pi
    second = np.arctan2(np.sin(turned), np.cos(turned))
    return second if np.abs(second).sum() < np.abs(first).sum() - 1e-9 else first


def rotation_from_vector(w: ArrayLike) -> NDArray[np.float64]:
    """exp(w): the matrix (3, 3) of a rotation vector (3,) in radians (Rodrigues; cv2.Rodrigues)."""
    return Rotation.from_rotvec(_vector(w)).as_matrix()


def vector_from_rotation(R: ArrayLike) -> NDArray[np.float64]:
    """log(R): the rotation vector (3,) in radians, length at most pi, of a rotation matrix (3, 3)."""
    return Rotation.from_matrix(check_rotation(R)).as_rotvec()


def shortest_vector(w: ArrayLike) -> NDArray[np.float64]:
    """The rotation vector (3,) of the same rotation whose length is at most pi; `w` itself where it is short."""
    vector = _vector(w)
    length = float(np.linalg.norm(vector))
    if length <= np.pi:
        return vector
    return vector * (1.0 - 2.0 * np.pi * np.round(length / (2.0 * np.pi)) / length)


def rotation_from_quaternion(xyzw: ArrayLike) -> NDArray[np.float64]:
    """The matrix (3, 3) of a quaternion (x, y, z, w), scalar last; it need not have unit length."""
    values = np.asarray(xyzw, dtype=np.float64)
    if values.shape != (4,) or not np.all(np.isfinite(values)) or np.linalg.norm(values) < 1e-6:
        raise GeometryError(
            "bad_rotation", "The quaternion is not four finite numbers x, y, z, w.", "Check its order."
        )
    return Rotation.from_quat(values).as_matrix()


def quaternion_from_rotation(R: ArrayLike) -> NDArray[np.float64]:
    """The unit quaternion (x, y, z, w) of a rotation matrix, with w >= 0."""
    return Rotation.from_matrix(check_rotation(R)).as_quat(canonical=True)


def check_rotation(R: ArrayLike) -> NDArray[np.float64]:
    """R as float64 (3, 3), rounding of its digits repaired (nearest rotation in the Frobenius norm).

    Raises GeometryError `bad_rotation` where it is not orthonormal and right-handed.
    """
    matrix = np.asarray(R, dtype=np.float64)
    if matrix.shape != (3, 3) or not np.all(np.isfinite(matrix)):
        raise GeometryError("bad_rotation", "A rotation matrix is three rows of three finite numbers.", "")
    error = np.max(np.abs(matrix @ matrix.T - np.eye(3)))
    # Published matrices carry four to six digits; more error than that is another kind of matrix.
    if error > 1e-3 or np.linalg.det(matrix) < 0:
        raise GeometryError(
            "bad_rotation",
            "The matrix is not a rotation: its rows are not orthonormal, or it mirrors.",
            "Check that it is the 3 x 3 part alone, without scale, and that no axis is flipped.",
        )
    if error > 1e-12:
        U, _, Vt = np.linalg.svd(matrix)
        return U @ Vt
    return matrix


def parse_euler_order(order: object) -> EulerOrder:
    """The Euler order of that name. Raises GeometryError `unknown_euler_order`."""
    for known in EULER_ORDERS:
        if order == known:
            return known
    raise GeometryError(
        "unknown_euler_order",
        f"There is no Euler order {order!r}.",
        "The orders are zyx (R = Rz(alpha) Ry(beta) Rx(gamma)) and xyz_eq2 (R = Rx(alpha) Ry(beta) Rz(gamma)).",
    )


def _vector(values: ArrayLike) -> NDArray[np.float64]:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise GeometryError("bad_rotation", "Three finite numbers are needed for a rotation.", "")
    return vector


# Exact arithmetic is requested explicitly: numba lets a callee inherit its caller's fast-math flags, so that its bits
# would depend on which caller was compiled first.
@njit(nogil=True, error_model="numpy", fastmath=False)
def rows_from_vector(x: float, y: float, z: float) -> Rows:
    """exp((x, y, z)) as nine numbers, row by row (Rodrigues)."""
    square = x * x + y * y + z * z
    if square < 1e-8:
        a = 1.0 - square / 6.0  # sin(t) / t
        b = 0.5 - square / 24.0  # (1 - cos(t)) / t^2
    else:
        angle = sqrt(square)
        a = sin(angle) / angle
        half = sin(0.5 * angle)
        b = 2.0 * half * half / square
    return (
        1.0 - b * (y * y + z * z),
        b * x * y - a * z,
        b * x * z + a * y,
        b * x * y + a * z,
        1.0 - b * (x * x + z * z),
        b * y * z - a * x,
        b * x * z - a * y,
        b * y * z + a * x,
        1.0 - b * (x * x + y * y),
    )


@njit(nogil=True, error_model="numpy", fastmath=False)
def rows_from_euler(alpha: float, beta: float, gamma: float) -> Rows:
    """Rz(alpha) Ry(beta) Rx(gamma) as nine numbers, row by row."""
    ca, sa = cos(alpha), sin(alpha)
    cb, sb = cos(beta), sin(beta)
    cg, sg = cos(gamma), sin(gamma)
    return (
        ca * cb,
        ca * sb * sg - sa * cg,
        ca * sb * cg + sa * sg,
        sa * cb,
        sa * sb * sg + ca * cg,
        sa * sb * cg - ca * sg,
        -sb,
        cb * sg,
        cb * cg,
    )


@njit(nogil=True, error_model="numpy", forceinline=True)
def rotation_rows(form: int, a: float, b: float, c: float) -> Rows:
    """The search rotation of FORM_ID `form`, row by row: exp(w), or Rz(alpha) Ry(beta) Rx(gamma)."""
    if form == 0:
        return rows_from_vector(a, b, c)
    return rows_from_euler(a, b, c)


@njit(nogil=True, error_model="numpy", fastmath=False)
def axes_of_vector(x: float, y: float, z: float) -> Rows:
    """Left Jacobian of exp at (x, y, z), row by row: column i is the axis about which parameter i turns.

    d exp(w) p = (J dw) x (exp(w) p). Source: Barfoot, State Estimation for Robotics, eq. 7.77.
    """
    square = x * x + y * y + z * z
    if square < 1e-6:
        b = 0.5 - square / 24.0  # (1 - cos(t)) / t^2
        c = 1.0 / 6.0 - square / 120.0  # (t - sin(t)) / t^3
    else:
        angle = sqrt(square)
        half = sin(0.5 * angle)
        b = 2.0 * half * half / square
        c = (angle - sin(angle)) / (square * angle)
    return (
        1.0 - c * (y * y + z * z),
        c * x * y - b * z,
        c * x * z + b * y,
        c * x * y + b * z,
        1.0 - c * (x * x + z * z),
        c * y * z - b * x,
        c * x * z - b * y,
        c * y * z + b * x,
        1.0 - c * (x * x + y * y),
    )


@njit(nogil=True, error_model="numpy", fastmath=False)
def axes_of_euler(alpha: float, beta: float) -> Rows:
    """As `axes_of_vector` for zyx angles: the columns are e_z, Rz e_y and Rz Ry e_x."""
    ca, sa = cos(alpha), sin(alpha)
    cb, sb = cos(beta), sin(beta)
    return (0.0, -sa, ca * cb, 0.0, ca, sa * cb, 1.0, 0.0, -sb)
