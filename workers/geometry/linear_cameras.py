"""Cameras by linear algebra alone: the direct linear transformation, and Tsai's radial alignment for wide lenses."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_OFFSETS_M: Final = np.linspace(-3.0, 3.0, 61)
_FAR: Final = 1e9


@dataclass(frozen=True, eq=False)
class LinearCamera:
    """R (3, 3) and t (3,) m of T_camera_lidar, and the intrinsics by name that linear algebra tells."""

    R: Floats
    t: Floats
    intrinsics: dict[str, float]


@dataclass(frozen=True, eq=False)
class LinearStart:
    """A way to fit linear cameras to pairs: points (n, 3) m, marks (n, 2) px, B sets of them at once.

    centre (2,) is where the optical axis meets the image; the radial alignment alone needs it.

    minimal: pairs that one camera needs. inlier_share: distance from the linear camera, as a share of the image's
        diagonal, up to which a pair counts as explained: it knows no tangential distortion, and the radial alignment
        no centre.
    fit: (points (B, n, 3), marks (B, n, 2), centre) gives cameras (B, 3, 4).
    distances: (cameras, points (N, 3), marks (N, 2), centre) gives distances (B, N) in px of the pairs from what the
        cameras say, huge where they look away.
    read: (camera (3, 4), points (n, 3), marks (n, 2), centre) gives its parts, or None where it is no camera.
    """

    minimal: int
    inlier_share: float
    fit: Callable[[Floats, Floats, Floats], Floats]
    distances: Callable[[Floats, Floats, Floats, Floats], Floats]
    read: Callable[[Floats, Floats, Floats, Floats], LinearCamera | None]

    def camera(self, points: Floats, marks: Floats, centre: Floats) -> LinearCamera | None:
        """The camera of pairs (n, 3), (n, 2) that hold no outliers; None where the linear solution is none."""
        P = self.fit(points[None], marks[None], centre)[0]
        return self.read(P, points, marks, centre) if np.all(np.isfinite(P)) else None


def _perspective_distances(cameras: Floats, points: Floats, marks: Floats, centre: Floats) -> Floats:
    projected = np.einsum("brc,nc->brn", cameras[:, :, :3], points) + cameras[:, :, 3:]
    depth = np.where(projected[:, 2] > 1e-6, projected[:, 2], 1e-6)
    distance = np.hypot(projected[:, 0] / depth - marks[:, 0], projected[:, 1] / depth - marks[:, 1])
    return np.where(projected[:, 2] > 1e-6, distance, _FAR)


def _radial_distances(cameras: Floats, points: Floats, marks: Floats, centre: Floats) -> Floats:
    # From the half line out of the centre on which the mark must lie.
    projected = np.einsum("brc,nc->brn", cameras[:, :, :3], points) + cameras[:, :, 3:]
    offset = marks - centre
    length = np.maximum(np.hypot(projected[:, 0], projected[:, 1]), 1e-300)
    across = np.abs(offset[:, 0] * projected[:, 1] - offset[:, 1] * projected[:, 0]) / length
    along = (offset[:, 0] * projected[:, 0] + offset[:, 1] * projected[:, 1]) / length
    return np.where(along > 0.0, across, np.hypot(offset[:, 0], offset[:, 1]))


def _direct_linear(points: Floats, marks: Floats, centre: Floats) -> Floats:
    # The rows are those of P = K [R | t].
    # Centred and scaled on both sides (Hartley 1997), or the equations are hopelessly conditioned.
    X, space = _normalised(points)
    x, image = _normalised(marks)
    ones = np.ones_like(X[..., :1])
    H = np.concatenate([X, ones], axis=-1)
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


def _radial_alignment(points: Floats, marks: Floats, centre: Floats) -> Floats:
    # The first two rows are [R | t]'s up to a common factor, the third is zero.
    offsets = marks - centre
    X, space = _normalised(points)
    H = np.concatenate([X, np.ones_like(X[..., :1])], axis=-1)
    A = np.concatenate([-offsets[..., 1:] * H, offsets[..., :1] * H], axis=-1)
    unit = A / np.maximum(np.linalg.norm(A, axis=-1, keepdims=True), 1e-300)
    rows = _null_vector(unit).reshape(-1, 2, 4) @ space
    projected = np.einsum("brc,bnc->bnr", rows[:, :, :3], points) + rows[:, None, :, 3]
    agree = np.sum(np.sign(np.sum(projected * offsets, axis=-1)), axis=1)
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


def _perspective_camera(P: Floats, points: Floats, marks: Floats, centre: Floats) -> LinearCamera | None:
    # RQ decomposition of P's left part by a QR of its reversed rows.
    flip = np.eye(3)[::-1]
    Q, U = np.linalg.qr((flip @ P[:, :3]).T)
    upper = flip @ U.T @ flip
    signs = np.diag(np.sign(np.diag(upper)))
    K, R = upper @ signs, signs @ flip @ Q.T
    # Marks in one place or on one line are projected by a matrix that no camera has.
    if np.abs(np.diag(K)).min() < 1e-9 or np.linalg.det(R) < 0.0:
        return None
    t = np.asarray(np.linalg.solve(K, P[:, 3]), dtype=np.float64)
    f_x, f_y, c_x, c_y = (np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]) / K[2, 2]).tolist()
    return LinearCamera(R, t, {"f_x": f_x, "f_y": f_y, "c_x": c_x, "c_y": c_y})


def _radial_camera(P: Floats, points: Floats, marks: Floats, centre: Floats) -> LinearCamera | None:
    offsets = marks - centre
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
    c_x, c_y = centre.tolist()
    return LinearCamera(R, t, {"f_x": best[2], "f_y": best[2], "c_x": c_x, "c_y": c_y, "k1": best[3]})


def direct_linear_start(inlier_share: float) -> LinearStart:
    """The direct linear transformation (Hartley and Zisserman 2004, algorithm 7.1), for perspective cameras."""
    return LinearStart(6, inlier_share, _direct_linear, _perspective_distances, _perspective_camera)


def radial_alignment_start(inlier_share: float) -> LinearStart:
    """Tsai's radial alignment (1987): it needs no perspective, so any field of view does."""
    return LinearStart(7, inlier_share, _radial_alignment, _radial_distances, _radial_camera)
