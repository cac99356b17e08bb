"""Vectors of projections for other implementations: ``python -m tests.workers.geometry.projection_vectors`` writes
them anew. The pages' node tests read the file, and a test beside this holds it to ``workers/geometry``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.rotations import rotation_from_euler
from workers.geometry.models import parse_model
from workers.geometry.projection import fold_angle, project

Floats = NDArray[np.float64]
FILE = Path(__file__).with_suffix(".json")
_FOCUS = {"f_x": 912.5, "f_y": 905.25, "c_x": 963.5, "c_y": 591.75}
LENSES: list[dict[str, Any]] = [
    {"model": "pinhole", **_FOCUS},
    {"model": "brown_conrady", **_FOCUS},
    # A wide lens of the kind that the paper calls fisheye, tangential and skewed.
    {"model": "brown_conrady", **_FOCUS, "skew": 1e-3, "k1": -0.31, "k2": 0.12, "k3": 8e-4, "k4": -5e-4, "k5": -0.02},
    # It folds within the image.
    {"model": "brown_conrady", **_FOCUS, "k1": -0.6, "k2": 0.05},
    {"model": "kannala_brandt", **_FOCUS},
    {"model": "kannala_brandt", **_FOCUS, "k1": 0.03, "k2": -0.02, "k3": 4e-3, "k4": -6e-4},
    {"model": "kannala_brandt", **_FOCUS, "k1": -0.12},
    # Coefficients of the size that a factory states of a wide stereo camera.
    {"model": "rational_polynomial", **_FOCUS, "k1": 4.9, "k2": 1.4, "k4": 5.3, "k5": 2.9, "k6": 0.16, "p1": 2e-4},
    # A divisor that ends within the image.
    {"model": "rational_polynomial", **_FOCUS, "k1": 0.1, "k4": 0.2, "k5": -0.5, "k6": -0.4, "p2": -3e-4},
]
# A camera that looks forward and a little down, beside the LiDAR.
ANGLES_DEG = (91.5, -88.2, 0.7)
TRANSLATION_M = (0.12, -0.31, -0.08)


def transform() -> dict[str, Any]:
    """T_camera_lidar as documents state it."""
    return {
        "to_frame": "camera",
        "from_frame": "lidar",
        "rotation": {"matrix": _rotation().tolist()},
        "translation_m": list(TRANSLATION_M),
    }


def _rotation() -> Floats:
    return rotation_from_euler(np.radians(ANGLES_DEG))


def in_camera(points_lidar: Floats) -> Floats:
    """Points (N, 3) of the LiDAR in the camera's frame, metres."""
    return points_lidar @ _rotation().T + np.array(TRANSLATION_M)


def points_for(lens: dict[str, Any]) -> Floats:
    """Points (N, 3), LiDAR frame: all around, on the axis, and on both sides of where the lens folds."""
    rng = np.random.default_rng(11)
    intrinsics = {name: value for name, value in lens.items() if name != "model"}
    fold = fold_angle(parse_model(lens["model"]), intrinsics)
    # Rounding finds folds of lenses without one, at 89.9 degrees.
    sides = fold + np.array([-1e-3, 1e-3]) if np.abs(np.array([np.pi / 2, np.pi]) - fold).min() > 0.01 else [np.pi]
    theta = np.concatenate([rng.uniform(0, 1.4, 30), rng.uniform(0, np.pi, 20), sides, [0.0]])
    phi = rng.uniform(-np.pi, np.pi, len(theta))
    rays = np.column_stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    camera = rays * rng.uniform(0.5, 60.0, (len(theta), 1))
    return np.round((camera - np.array(TRANSLATION_M)) @ _rotation(), 6)


def pixels_of(lens: dict[str, Any], points_lidar: Floats) -> list[list[float] | None]:
    """Each point's pixel; None where it has no good projection."""
    intrinsics = {name: value for name, value in lens.items() if name != "model"}
    pixels, violation = project(parse_model(lens["model"]), intrinsics, in_camera(points_lidar))
    return [None if bad else pixel for pixel, bad in zip(pixels.tolist(), violation > 0.0, strict=True)]


def document() -> dict[str, Any]:
    """All cases."""
    cases: list[dict[str, Any]] = []
    for lens in LENSES:
        points = points_for(lens)
        cases.append(
            {
                "intrinsics": lens,
                "transform": transform(),
                "points_lidar": points.tolist(),
                "pixels": pixels_of(lens, points),
            }
        )
    return {"cases": cases}


if __name__ == "__main__":
    lines = ",\n".join(json.dumps(case) for case in document()["cases"])
    FILE.write_text(f'{{"cases": [\n{lines}\n]}}\n')
