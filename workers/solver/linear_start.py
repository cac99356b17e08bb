"""Cameras by linear algebra alone: the direct linear transformation, and Tsai's radial alignment for wide lenses."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.geometry.models import ModelName

Floats = NDArray[np.float64]
MINIMAL: Final[dict[ModelName, int]] = {"pinhole": 6, "brown_conrady": 6, "kannala_brandt": 7}
"""Pairs that one linear camera needs."""
_OFFSETS_M: Final = np.linspace(-3.0, 3.0, 61)
_FAR: Final = 1e9


@dataclass(frozen=True, eq=False)
class Camera:
    """R (3, 3) and t (3,) m of T_camera_lidar, intrinsics (f_x, f_y, c_x, c_y) px, and the fisheye's first term."""

    R: Floats
    t: Floats
    intrinsics: Floats
    k1: float = 0.0


def fit_linear(model: ModelName, points: Floats, marks: Floats, centre: Floats) -> Floats:
    """Linear cameras (B, 3, 4) of B sets of pairs: points (B, n, 3) m, marks (B, n, 2) px.

    The rows are those of P = K [R | t]; for `kannala_brandt` the first two are [R | t]'s up to a common factor and
    the third is zero. centre (2,): where the optical axis meets the image, for the radial alignment alone.
    """
    if model == "kannala_brandt":
        return _radial_alignment(points, marks - centre)
    return _direct_linear(points, marks)


def linear_distances(model: ModelName, cameras: Floats, points: Floats, marks: Floats, centre: Floats) -> Floats:
    """Distances (B, N) in px of N pairs from what the cameras (B, 3, 4) say; huge where they look away.

    For the radial alignment: from the half line out of the centre on which the mark must lie.
    """
    seen = np.einsum("brc,nc->brn", cameras[:, :, :3], points) + cameras[:, :, 3:]
    if model == "kannala_brandt":
        offset = marks - centre
        length = np.maximum(np.hypot(seen[:, 0], seen[:, 1]), 1e-300)
        across = np.abs(offset[:, 0] * seen[:, 1] - offset[:, 1] * seen[:, 0]) / length
        along = (offset[:, 0] * seen[:, 0] + offset[:, 1] * seen[:, 1]) / length
        return np.where(along > 0.0, across, np.hypot(offset[:, 0], offset[:, 1]))
    depth = np.where(seen[:, 2] > 1e-6, seen[:, 2], 1e-6)
    distance = np.hypot(seen[:, 0] / depth - marks[:, 0], seen[:, 1] / depth - marks[:, 1])
    return np.where(seen[:, 2] > 1e-6, distance, _FAR)


def camera_of(model: ModelName, points: Floats, marks: Floats, centre: Floats) -> Camera | None:
    """The camera of pairs (n, 3), (n, 2) that hold no outliers; None where the linear solution is none."""
    P = fit_linear(model, points[None], marks[None], centre)[0]
    if not np.all(np.isfinite(P)):
        return None
    return _fisheye(P, points, marks - centre, centre) if model == "kannala_brandt" else _perspective(P)


def _direct_linear(points: Floats, marks: Floats) -> Floats:
    # Centred and scaled on both sides (Hartley 1997), or the equations are hopelessly conditioned.
    X, space = _normalised(points)
    x, image = _normalised(marks)
    one = np.ones_like(X[..., :1])
    H = np.concatenate([X, one], axis=-1)
    none = np.zeros_like(H)
    rows = [
        np.concatenate([H, none, -x[..., :1] * H], axis=-1),
        np.concatenate([none, H, -x[..., 1:] * H], axis=-1),
    ]
    P = np.linalg.inv(image) @ _null_vector(np.concatenate(rows, axis=1)).reshape(-1, 3, 4) @ space
    # The sign under which a right-handed camera looks forward; depths in metres.
    M = P[:, :, :3]
    factor = np.sign(np.linalg.det(M)) / np.maximum(np.linalg.norm(M[:, 2], axis=1), 1e-300)
    return P * factor[:, None, None]


def _radial_alignment(points: Floats, offsets: Floats) -> Floats:
    X, space = _normalised(points)
    H = np.concatenate([X, np.ones_like(X[..., :1])], axis=-1)
    A = np.concatenate([-offsets[..., 1:] * H, offsets[..., :1] * H], axis=-1)
    unit = A / np.maximum(np.linalg.norm(A, axis=-1, keepdims=True), 1e-300)
    rows = _null_vector(unit).reshape(-1, 2, 4) @ space
    seen = np.einsum("brc,bnc->bnr", rows[:, :, :3], points) + rows[:, None, :, 3]
    agree = np.sum(np.sign(np.sum(seen * offsets, axis=-1)), axis=1)
    rows *= np.where(agree < 0.0, -1.0, 1.0)[:, None, None]
    return np.concatenate([rows, np.zeros_like(rows[:, :1])], axis=1)


def _normalised(values: Floats) -> tuple[Floats, Floats]:
    # (B, n, d) about their mean with mean distance sqrt(d), and the homogeneous matrices (B, d + 1, d + 1) of that.
    d = values.shape[-1]
    mean = values.mean(axis=1, keepdims=True)
    spread = np.maximum(np.linalg.norm(values - mean, axis=-1).mean(axis=1), 1e-12) / np.sqrt(d)
    T = np.zeros((len(values), d + 1, d + 1))
    T[:, range(d), range(d)] = (1.0 / spread)[:, None]
    T[:, :d, d] = -mean[:, 0] / spread[:, None]
    T[:, d, d] = 1.0
    return (values - mean) / spread[:, None, None], T


def _null_vector(A: Floats) -> Floats:
    # The eigenvector of the least eigenvalue of A^T A (B, m): for these normalised equations as good as an SVD.
    return np.linalg.eigh(np.swapaxes(A, 1, 2) @ A)[1][:, :, 0]


def _perspective(P: Floats) -> Camera | None:
    # RQ decomposition of P's left part by a QR of its reversed rows.
    flip = np.eye(3)[::-1]
    Q, U = np.linalg.qr((flip @ P[:, :3]).T)
    upper = flip @ U.T @ flip
    signs = np.diag(np.sign(np.diag(upper)))
    K, R = upper @ signs, signs @ flip @ Q.T
    if abs(K[2, 2]) < 1e-9 or np.linalg.det(R) < 0.0:
        return None
    t = np.asarray(np.linalg.solve(K, P[:, 3]), dtype=np.float64)
    return Camera(R, t, np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]) / K[2, 2])


def _fisheye(P: Floats, points: Floats, offsets: Floats, centre: Floats) -> Camera | None:
    U, s, Vt = np.linalg.svd(P[:2, :3])
    if s[1] < 1e-9 * s[0]:
        return None
    rows = U @ Vt[:2]
    R = np.stack([rows[0], rows[1], np.cross(rows[0], rows[1])])
    t = np.append(P[:2, 3] / (0.5 * (s[0] + s[1])), 0.0)
    x, y, z = (points @ R.T + t).T
    beside, radius = np.hypot(x, y), np.hypot(offsets[:, 0], offsets[:, 1])
    best = (np.inf, 0.0, 1.0, 0.0)
    for offset in _OFFSETS_M:
        # How far forward the camera stands decides the angles; then f and f k1 are a linear fit of the radii.
        theta = np.arctan2(beside, z + offset)
        (f, f_k1), *_ = np.linalg.lstsq(np.stack([theta, theta**3], axis=1), radius)
        squares = float(np.sum((f * theta + f_k1 * theta**3 - radius) ** 2))
        if f > 0.0 and squares < best[0]:
            best = (squares, float(offset), float(f), float(f_k1 / f))
    if not np.isfinite(best[0]):
        return None
    t[2] = best[1]
    return Camera(R, t, np.array([best[2], best[2], *centre]), best[3])
