"""Rigs of three cameras to export, points that their cameras see, and where these are according to us."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
from scipy.spatial.transform import Rotation

from apexcal.geometry.se3 import SE3
from service.exports.calibrated import Calibrated, CalibratedCamera
from workers.geometry.projection import project

WIDTH, HEIGHT = 1920, 1200
# Pixels over the whole image.
MARKED = np.stack(np.meshgrid(np.linspace(0, 1919, 17), np.linspace(0, 1199, 13)), axis=-1).reshape(-1, 2)
LENSES = {
    "pinhole": {},
    "brown_conrady": {"skew": 0.0, "k1": -0.31, "k2": 0.11, "k3": 7e-5, "k4": -4.1e-4, "k5": -0.015},
    "kannala_brandt": {"k1": -0.013, "k2": 0.0041, "k3": -9e-6, "k4": 0.00003},
    "rational_polynomial": {
        "k1": 4.655,
        "k2": 1.348,
        "p1": 7e-5,
        "p2": -4.1e-4,
        "k3": 0.012,
        "k4": 5.02,
        "k5": 2.8,
        "k6": 0.15,
    },
}
# LiDAR axes (x forward, y left, z up) to optical ones (x right, y down, z forward).
_LEVEL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
NAMES = ("front", "left.rear", "mast-1")


def lens(model: str, seed: int, **changed: float) -> dict[str, float]:
    random = np.random.default_rng(seed)
    f_x, c_x, c_y = random.uniform(900, 1300), random.uniform(900, 1000), random.uniform(560, 640)
    return {"f_x": f_x, "f_y": f_x * 1.01, "c_x": c_x, "c_y": c_y} | LENSES[model] | changed


def mount(number: int, rig: int) -> SE3:
    """T_camera_lidar. Those of the second rig are anyhow turned; its last stands upright, where Euler angles end."""
    random = np.random.default_rng(100 * rig + number)
    turn = Rotation.from_euler("z", 70.0 * number, degrees=True).as_matrix()
    R = _LEVEL @ turn @ Rotation.from_rotvec(random.normal(0, 0.03, 3)).as_matrix()
    if rig == 1:
        R = Rotation.random(random_state=number + 1).as_matrix()
    if rig == 1 and number == 2:
        R = Rotation.from_euler("z", 90, degrees=True).as_matrix() @ _LEVEL
    return SE3(f"camera{number}/camera_optical_link", "velodyne", R, random.uniform(-1.5, 1.5, 3))


def vehicle_mount(rig: int) -> SE3:
    R = Rotation.from_euler("xyz", [0.5, -2.0, 3.0 + 90 * rig], degrees=True).as_matrix()
    return SE3("base_link", "velodyne", R, np.array([1.2, 0.0, 1.9]))


def rig_of(model: str, rig: int, *, on_vehicle: bool = True, **changed: float) -> Calibrated:
    cameras = [
        CalibratedCamera(
            name=name,
            topic=f"/camera{number}/image",
            width=WIDTH,
            height=HEIGHT,
            model=model,
            intrinsics=lens(model, 10 * rig + number, **changed),
            T_camera_lidar=mount(number, rig),
            T_vehicle_lidar=vehicle_mount(rig) if on_vehicle else None,
            rig="roof",
            source=f"0000000{number}",
            at=datetime(2026, 3, 5, 7, 8, 9, tzinfo=UTC),
            marked=MARKED,
        )
        for number, name in enumerate(NAMES)
    ]
    return Calibrated(f"Truck {rig}", cameras)


def seen(camera: CalibratedCamera) -> np.ndarray:
    """Points (n, 3) in the LiDAR's frame, all inside of the image and well short of where the lens folds."""
    random = np.random.default_rng(7)
    points = np.stack([random.uniform(-12, 12, 600), random.uniform(-8, 8, 600), random.uniform(2, 30, 600)], axis=1)
    pixels, violation = project(camera.model, camera.intrinsics, points)
    inside = (violation <= 0) & (pixels >= 0).all(axis=1) & (pixels < [WIDTH, HEIGHT]).all(axis=1)
    assert inside.sum() > 60
    back = camera.T_camera_lidar.inverse()
    return points[inside] @ back.R.T + back.t


def ours(camera: CalibratedCamera) -> np.ndarray:
    """Where the points are by our own projection."""
    T = camera.T_camera_lidar
    return project(camera.model, camera.intrinsics, seen(camera) @ T.R.T + T.t)[0]
