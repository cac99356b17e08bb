"""Rotations: matrices, Euler angles in both orders, rotation vectors and quaternions (scalar last).

Vectors and quaternions go as in SciPy, whose bits they give without its import.
"""

from math import atan2, cos, sin, sqrt
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.errors import GeometryError

EulerOrder = Literal["zyx", "xyz_eq2"]
EULER_ORDERS: Final[tuple[EulerOrder, ...]] = ("zyx", "xyz_eq2")
FORWARD_LIDAR_TO_OPTICAL: Final[NDArray[np.float64]] = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""R_camera_lidar of a level camera that looks along x of a LiDAR with x forward, y left, z up."""

Floats = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
# Radians below which sin and cos of small angles are taken by their series.
_SMALL: Final = 1e-3
# Cosine of the middle angle at which it is singular.
_SINGULAR: Final = 1e-7


def rotation_from_euler(angles: ArrayLike, order: EulerOrder = "zyx") -> Floats:
    """The matrix (3, 3) of (alpha, beta, gamma) in radians.

    `zyx`: R = Rz(alpha) Ry(beta) Rx(gamma), as the paper's released toolbox computes it.
    `xyz_eq2`: R = Rx(alpha) Ry(beta) Rz(gamma), as the paper's equation 2 prints it.
    """
    if order == "xyz_eq2":
        return _mirrored(rotation_from_euler(-_vector(angles)))
    (sa, sb, sg), (ca, cb, cg) = np.sin(_vector(angles)), np.cos(_vector(angles))
    return np.array(
        [
            [ca * cb, ca * sb * sg - sa * cg, ca * sb * cg + sa * sg],
            [sa * cb, sa * sb * sg + ca * cg, sa * sb * cg - ca * sg],
            [-sb, cb * sg, cb * cg],
        ]
    )


def euler_from_rotation(R: ArrayLike, order: EulerOrder = "zyx") -> Floats:
    """(alpha, beta, gamma) in radians, shape (3,), of a rotation matrix (3, 3).

    Every rotation has two such triples; the one whose absolute values sum to less is given, so that a camera
    tilted 15 degrees down reads (90, -105, 0) degrees and lies in the paper's box, not (-90, -75, 180).
    At the singular point (|beta| = pi/2) alpha and gamma act alike; gamma is 0 there and alpha carries the sum.
    """
    matrix = check_rotation(R)
    first = _zyx(matrix) if order == "zyx" else -_zyx(_mirrored(matrix))
    turned = first * (1.0, -1.0, 1.0) + np.pi
    second = np.arctan2(np.sin(turned), np.cos(turned))
    return second if np.abs(second).sum() < np.abs(first).sum() - 1e-9 else first


def rotation_from_vector(w: ArrayLike) -> Floats:
    """exp(w): the matrix (3, 3) of a rotation vector (3,) in radians (Rodrigues; cv2.Rodrigues)."""
    x, y, z = _vector(w).tolist()
    angle = sqrt(x * x + y * y + z * z)
    scale = 0.5 - angle**2 / 48.0 + angle**4 / 3840.0 if angle <= _SMALL else sin(angle / 2.0) / angle
    return _matrix((scale * x, scale * y, scale * z, cos(angle / 2.0)))


def vector_from_rotation(R: ArrayLike) -> Floats:
    """log(R): the rotation vector (3,) in radians, length at most pi, of a rotation matrix (3, 3)."""
    q = _quaternion(check_rotation(R))
    x, y, z, w = (-part for part in q) if q[3] < 0.0 else q
    angle = 2.0 * atan2(sqrt(x * x + y * y + z * z), w)
    scale = 2.0 + angle**2 / 12.0 + 7.0 * angle**4 / 2880.0 if angle <= _SMALL else angle / sin(angle / 2.0)
    return np.array([scale * x, scale * y, scale * z])


def shortest_vector(w: ArrayLike) -> Floats:
    """The rotation vector (3,) of the same rotation whose length is at most pi; `w` itself where it is short."""
    vector = _vector(w)
    length = float(np.linalg.norm(vector))
    if length <= np.pi:
        return vector
    return vector * (1.0 - 2.0 * np.pi * np.round(length / (2.0 * np.pi)) / length)


def rotation_from_quaternion(xyzw: ArrayLike) -> Floats:
    """The matrix (3, 3) of a quaternion (x, y, z, w), scalar last; it need not have unit length."""
    values = np.asarray(xyzw, dtype=np.float64)
    if values.shape != (4,) or not np.all(np.isfinite(values)) or np.linalg.norm(values) < 1e-6:
        raise GeometryError(
            "bad_rotation", "The quaternion is not four finite numbers x, y, z, w.", "Check its order."
        )
    x, y, z, w = values.tolist()
    return _matrix(_unit((x, y, z, w)))


def quaternion_from_rotation(R: ArrayLike) -> Floats:
    """The unit quaternion (x, y, z, w) of a rotation matrix, with w >= 0."""
    q = np.array(_quaternion(check_rotation(R)))
    return -q if q[3] < 0.0 else q


def check_rotation(R: ArrayLike) -> Floats:
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


def _vector(values: ArrayLike) -> Floats:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise GeometryError("bad_rotation", "Three finite numbers are needed for a rotation.", "")
    return vector


def _mirrored(R: Floats) -> Floats:
    """Return the turn with the axes x and z exchanged: Rx(a) Ry(b) Rz(g) becomes Rz(-a) Ry(-b) Rx(-g), and back."""
    return R[::-1, ::-1].copy()


def _zyx(R: Floats) -> Floats:
    flat = np.hypot(R[0, 0], R[1, 0])
    beta = np.arctan2(-R[2, 0], flat)
    if flat <= _SINGULAR:
        return np.array([np.arctan2(-R[0, 1], R[1, 1]), beta, 0.0])
    alpha = np.arctan2(R[1, 0], R[0, 0])
    # From what the first turn leaves, so that near the singular point the two angles keep their sum.
    cosine, minus_sine = np.array([-np.sin(alpha), np.cos(alpha)]) @ R[:2, 1:]
    return np.array([alpha, beta, np.arctan2(-minus_sine, cosine)])


def _unit(q: Quaternion) -> Quaternion:
    length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] / length, q[1] / length, q[2] / length, q[3] / length


def _matrix(q: Quaternion) -> Floats:
    """R (3, 3) of a unit quaternion."""
    x, y, z, w = q
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    return np.array(
        [
            [xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)],
            [2.0 * (xy + zw), -xx + yy - zz + ww, 2.0 * (yz - xw)],
            [2.0 * (xz - yw), 2.0 * (yz + xw), -xx - yy + zz + ww],
        ]
    )


def _quaternion(R: Floats) -> Quaternion:
    """The unit quaternion of R, by its largest element (Shepperd, J. Guidance and Control 1(3), 1978)."""
    m: list[list[float]] = R.tolist()
    trace = m[0][0] + m[1][1] + m[2][2]
    largest = [m[0][0], m[1][1], m[2][2], trace]
    i = largest.index(max(largest))
    if i == 3:
        return _unit((m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1.0 + trace))
    j, k = (i + 1) % 3, (i + 2) % 3
    q = [0.0, 0.0, 0.0, m[k][j] - m[j][k]]
    q[i], q[j], q[k] = 1.0 - trace + 2.0 * m[i][i], m[j][i] + m[i][j], m[k][i] + m[i][k]
    return _unit((q[0], q[1], q[2], q[3]))
