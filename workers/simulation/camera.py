"""The simulated camera: its lens, its mount near the LiDAR, and the rays of its pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents.simulation import FRONT, NOMINAL_PITCH_DOWN_DEG
from apexcal.geometry.rotations import rotation_from_euler, rotation_from_vector
from apexcal.geometry.se3 import SE3
from workers.geometry.models import INTRINSICS, ModelName
from workers.geometry.projection import project, unproject

LIDAR_FRAME = "velodyne"
IMAGE_SIZE = (960, 600)

# Wide lenses, about 100 degrees across, that a camera of this size could have; only that of pinhole keeps
# straight lines straight.
LENSES: dict[ModelName, dict[str, float]] = {
    "pinhole": {"f_x": 431.5, "f_y": 430.0, "c_x": 483.6, "c_y": 297.1},
    "brown_conrady": {
        "f_x": 431.0, "f_y": 429.6, "c_x": 484.3, "c_y": 296.2, "skew": 0.0,
        "k1": -0.28, "k2": 0.08, "k3": 0.0006, "k4": -0.0004, "k5": 0.0,
    },
    "kannala_brandt": {
        "f_x": 452.0, "f_y": 451.0, "c_x": 483.0, "c_y": 297.5,
        "k1": -0.025, "k2": 0.012, "k3": -0.009, "k4": 0.002,
    },
    "rational_polynomial": {
        "f_x": 431.0, "f_y": 429.6, "c_x": 484.3, "c_y": 296.2,
        "k1": 0.6, "k2": 0.05, "p1": 0.0006, "p2": -0.0004, "k3": 0.0, "k4": 0.8, "k5": 0.13, "k6": 0.0,
    },
}  # fmt: skip

# As in the paper: near the LiDAR. The camera's centre in the LiDAR frame, metres.
NOMINAL_CENTRE_M = (0.10, 0.05, -0.25)
_MOUNT_SIGMA_DEG = 1.2
_MOUNT_SIGMA_M = 0.02
_FOCAL_SIGMA = 0.008
_CENTRE_SIGMA_PX = 4.0


def camera_frame(name: str) -> str:
    """The coordinate frame of the camera of that name."""
    return f"camera_{name}_optical"


CAMERA_FRAME = camera_frame(FRONT)


@dataclass(frozen=True, slots=True)
class SimulatedCamera:
    """A lens on a mount.

    Attributes:
        intrinsics: by name, in the order of the model.
        image_size: width, height in pixels.
        T_camera_lidar: the mount, LiDAR points into the optical frame.
    """

    model: ModelName
    intrinsics: Mapping[str, float]
    image_size: tuple[int, int]
    T_camera_lidar: SE3

    def project(self, points_lidar: ArrayLike) -> NDArray[np.float64]:
        """Pixels (N, 2) of points (N, 3) in the LiDAR frame; not a number where the lens cannot see them."""
        return project(self.model, self.intrinsics, self.T_camera_lidar.apply(points_lidar))[0]

    def sees(self, pixels: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which pixels (N, 2) lie inside the image."""
        width, height = self.image_size
        u, v = pixels[:, 0], pixels[:, 1]
        return (u >= -0.5) & (u <= width - 0.5) & (v >= -0.5) & (v <= height - 0.5)

    def intrinsics_document(self) -> dict[str, Any]:
        """The JSON form: model, the parameters by name, image_size."""
        return {"model": self.model, **self.intrinsics, "image_size": list(self.image_size)}

    def rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Directions (N, 3) in the LiDAR frame, z = 1 in the camera frame, of pixels (N, 2).

        For lenses that see less than 90 degrees to the side.
        """
        rays, _ = unproject(self.model, self.intrinsics, pixels)
        return rays / rays[:, 2:] @ self.T_camera_lidar.R

    def centre(self) -> NDArray[np.float64]:
        """The camera's centre (3,) in the LiDAR frame, metres."""
        return self.T_camera_lidar.inverse().t


def nominal_mount(name: str = FRONT, yaw_deg: float = 0.0, pitch_down_deg: float = NOMINAL_PITCH_DOWN_DEG) -> SE3:
    """T_camera_lidar as the rig's drawing says: level but for the pitch, centimetres rounded.

    ``yaw_deg`` turns the camera and the arm that it sits on to the left.
    """
    R = rotation_from_euler(np.deg2rad((90.0, -90.0 - pitch_down_deg, 0.0)))
    arm = np.array(NOMINAL_CENTRE_M)
    if yaw_deg != 0.0:
        to_left = rotation_from_vector(np.array([0.0, 0.0, np.deg2rad(yaw_deg)]))
        arm, turned = np.round(to_left @ arm, 2), R @ to_left.T
        return SE3(camera_frame(name), LIDAR_FRAME, turned, -turned @ arm)
    return SE3(camera_frame(name), LIDAR_FRAME, R, -R @ arm)


def true_mount(seed: int, nominal: SE3 | None = None, number: int = 0) -> SE3:
    """T_camera_lidar as it was really bolted on: the nominal mount, off by a few degrees and centimetres."""
    random = np.random.default_rng([seed, 3, number] if number else [seed, 3])
    drawn = nominal or nominal_mount()
    R = rotation_from_vector(np.deg2rad(random.normal(0.0, _MOUNT_SIGMA_DEG, 3))) @ drawn.R
    centre = drawn.inverse().t + random.normal(0.0, _MOUNT_SIGMA_M, 3)
    return SE3(drawn.to_frame, LIDAR_FRAME, R, -R @ centre)


def make_camera(model: ModelName, seed: int, nominal: SE3 | None = None, number: int = 0) -> SimulatedCamera:
    """The camera of that model on its true mount; all but the first of a rig differ a little in their lenses."""
    lens = {name: LENSES[model][name] for name in INTRINSICS[model]}
    if number:
        random = np.random.default_rng([seed, 9, number])
        lens |= {name: lens[name] * (1.0 + random.normal(0.0, _FOCAL_SIGMA)) for name in ("f_x", "f_y")}
        lens |= {name: lens[name] + random.normal(0.0, _CENTRE_SIGMA_PX) for name in ("c_x", "c_y")}
    return SimulatedCamera(model, lens, IMAGE_SIZE, true_mount(seed, nominal, number))
