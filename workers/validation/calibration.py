"""A finished calibration as validation uses it: lens, mount and their covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import radians
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.camera_models import ANGLES
from apexcal.geometry.rotations import rotation_from_vector
from apexcal.geometry.se3 import SE3, from_document
from workers.geometry.models import INTRINSICS, ModelName, parse_model
from workers.geometry.projection import project
from workers.geometry.projections.table import PROJECTIONS

Floats = NDArray[np.float64]

_MOUNT = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z")


@dataclass(frozen=True, eq=False)
class KnownCalibration:
    """Lens and mount of a camera.

    Attributes:
        model, intrinsics: the lens; intrinsics in the order of INTRINSICS.
        image_size: width, height, px.
        mount: T_camera_lidar.
        names: parameters whose covariance is stated: small turns about the camera's axes, translation, lens.
        covariance: (F, F), radians, metres and pixels; (0, 0) where nothing is stated.
        sigma_px: stated noise of a mark, px per coordinate; None where nothing is stated.
    """

    model: ModelName
    intrinsics: Floats
    image_size: tuple[int, int]
    mount: SE3
    names: tuple[str, ...] = ()
    covariance: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    sigma_px: float | None = None

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Self:
        """Make one of {"intrinsics", "transform"} and, if a result states them, "covariance" and "sigma_px".

        Raises:
            GeometryError: not a lens or a transform.
        """
        lens = document["intrinsics"]
        model = parse_model(lens["model"])
        width, height = lens["image_size"]
        stated: dict[str, Any] = document.get("covariance") or {"names": [], "matrix": []}
        # If the search was over Euler angles, their deviations are not those of turns about the camera's axes.
        listed: list[str] = stated["names"]
        names = tuple(listed) if set(_MOUNT[:3]) <= set(listed) else ()
        unit = np.array([radians(1.0) if name in ANGLES else 1.0 for name in names])
        covariance = np.array(stated["matrix"], np.float64) * np.outer(unit, unit) if names else np.zeros((0, 0))
        values = np.array([lens.get(name) or 0.0 for name in INTRINSICS[model]], np.float64)
        mount = from_document(document["transform"])
        return cls(model, values, (int(width), int(height)), mount, names, covariance, document.get("sigma_px"))

    def project(self, points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return (N, 2) px of points (N, 3), metres, LiDAR frame; and which of them lie in the image."""
        pixels, violation = project(self.model, self.intrinsics, self.mount.apply(points))
        return pixels, self.shows(pixels, violation)

    def shows(self, pixels: Floats, violation: Floats) -> NDArray[np.bool_]:
        """Return which projections lie in the image."""
        width, height = self.image_size
        u, v = pixels[:, 0], pixels[:, 1]
        good = violation == 0.0
        return good & (u >= -0.5) & (u <= width - 0.5) & (v >= -0.5) & (v <= height - 0.5)

    def moved(self, turn_deg: Floats, shift_m: Floats) -> KnownCalibration:
        """Return the calibration with its mount turned about the camera's axes x y z, then shifted along them."""
        camera = self.mount.to_frame
        moved = SE3(camera, camera, rotation_from_vector(np.radians(turn_deg)), shift_m)
        return replace(self, mount=moved @ self.mount)

    def jacobians(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives of the pixels of points (N, 3), LiDAR frame.

        Returns (N, 2, 6) by small turns about the camera's axes (px per rad) and translation (px per m); and
        (N, 2, F) by the parameters of `names`.
        """
        moved = np.ascontiguousarray(self.mount.apply(points))
        count = len(moved)
        by_point = np.empty((count, 2, 3))
        by_lens = np.empty((count, 2, len(self.intrinsics)))
        PROJECTIONS[self.model].jacobians_into(self.intrinsics.copy(), moved, by_point, by_lens)
        turned = moved - self.mount.t
        # A turn w moves a point q by w x q.
        by_turn = np.stack([np.einsum("nij,nj->ni", by_point, np.cross(axis, turned)) for axis in np.eye(3)], axis=2)
        by_mount = np.concatenate([by_turn, by_point], axis=2)
        columns = dict(zip(_MOUNT, np.moveaxis(by_mount, 2, 0), strict=True))
        columns |= dict(zip(INTRINSICS[self.model], np.moveaxis(by_lens, 2, 0), strict=True))
        chosen = [columns[name] for name in self.names]
        return by_mount, np.stack(chosen, axis=2) if chosen else np.zeros((count, 2, 0))
