"""The simulator's ground truth: true vertices, and projections with the true parameters."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from apexcal.documents.camera_models import CAMERA_MODELS
from apexcal.documents.correspondence_sets import PairView
from apexcal.documents.transforms import SolvedTransform
from apexcal.transport import Document

Floats = NDArray[np.float64]


class Truth:
    """``truth.json`` of a simulated recording."""

    def __init__(self, path: Path) -> None:
        document: Document = json.loads(path.read_text(encoding="utf-8"))
        self.intrinsics: Document = document["intrinsics"]
        self.model = str(self.intrinsics["model"])
        self.R, self.t = rotation_and_translation(document["transform"])
        frames = document["frames"]
        self._frames: dict[int, tuple[Floats, list[float | None], bool]] = {
            stamp: (np.array(xyz), uv, is_visible)
            for stamp, xyz, uv, is_visible in zip(
                frames["stamp_ns"], frames["apex_xyz"], frames["apex_uv"], frames["apex_in_image"], strict=True
            )
        }

    def apex(self, frame_stamp_ns: int) -> tuple[Floats, tuple[float, float] | None]:
        """The vertex at a camera frame: metres in the LiDAR frame, and its pixel where the image shows it."""
        xyz, uv, is_visible = self._frames[frame_stamp_ns]
        if not is_visible or uv[0] is None or uv[1] is None:
            return xyz, None
        return xyz, (uv[0], uv[1])

    def errors_px(self, pairs: Sequence[PairView]) -> Floats:
        """Distance in pixels between each pair's mark and what the true parameters make of its point, (N,)."""
        points = np.array([[pair.x, pair.y, pair.z] for pair in pairs], np.float64)
        marks = np.array([[pair.u, pair.v] for pair in pairs], np.float64)
        return np.linalg.norm(project(self.intrinsics, points @ self.R.T + self.t) - marks, axis=1)

    def errors_of(self, transform: SolvedTransform) -> tuple[float, float]:
        """How far a ``T_camera_lidar`` is off: the angle in degrees, and the lever arm |t - t_true| in metres."""
        R, t = np.array(transform.rotation.matrix, np.float64), np.array(transform.translation_m, np.float64)
        # |R - R_true| = 2 sqrt(2) sin(angle / 2) in the Frobenius norm: exact for small angles, where acos is not.
        angle = 2.0 * np.arcsin(min(1.0, float(np.linalg.norm(R - self.R)) / (2.0 * np.sqrt(2.0))))
        return float(np.degrees(angle)), float(np.linalg.norm(t - self.t))


def rotation_and_translation(transform: Document) -> tuple[Floats, Floats]:
    """R (3, 3) and t (3,) of a transform document that holds a matrix."""
    return np.array(transform["rotation"]["matrix"], np.float64), np.array(transform["translation_m"], np.float64)


def project(intrinsics: dict[str, Any], points_camera: Floats) -> Floats:
    """Pixels (N, 2) of points (N, 3) in the optical frame, by ``cv2.projectPoints`` or ``cv2.fisheye``."""
    f_x, f_y, c_x, c_y = (float(intrinsics[name]) for name in ("f_x", "f_y", "c_x", "c_y"))
    skew = float(intrinsics.get("skew", 0.0))
    model = CAMERA_MODELS[intrinsics["model"]]
    D = np.array([float(intrinsics.get(name, 0.0)) for name in model.distortion] or [0.0] * 5)
    K = np.array([[f_x, 0.0, c_x], [0.0, f_y, c_y], [0.0, 0.0, 1.0]])
    points = points_camera.reshape(-1, 1, 3)
    zero = np.zeros(3)
    if model.written_as is not None and model.written_as.is_cv2_fisheye:
        pixels = cv2.fisheye.projectPoints(points, zero, zero, K, D)[0].reshape(-1, 2)
    else:
        pixels = cv2.projectPoints(points, zero, zero, K, D)[0].reshape(-1, 2)
        # cv2 leaves K[0, 1] out: u = f_x (a_d + skew b_d) + c_x.
        pixels[:, 0] += f_x * skew * (pixels[:, 1] - c_y) / f_y
    return pixels.astype(np.float64)
