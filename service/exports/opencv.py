"""OpenCV's FileStorage (YAML), one file for each camera: for ``cv2.projectPoints`` or ``cv2.fisheye``."""

from __future__ import annotations

import json

import numpy as np

from apexcal.geometry.se3 import Floats
from service.exports.calibrated import CalibratedCamera
from service.exports.format import Format, each_camera, numbers


def _matrix(name: str, values: Floats) -> list[str]:
    rows, columns = values.shape
    head = [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
    # The parser knows lines of a few thousand letters at most.
    return [*head, "   data: [ " + ",\n       ".join(map(repr, numbers(values))) + " ]"]


def _camera(camera: CalibratedCamera) -> str:
    lines = [
        "%YAML:1.0",
        "---",
        f"image_width: {camera.width}",
        f"image_height: {camera.height}",
        f"fisheye_model: {int(camera.written_as.is_cv2_fisheye)}",
        *_matrix("camera_matrix", np.array(camera.K)),
        *_matrix("distortion_coefficients", np.array([camera.D]).T),
        f"camera_frame: {json.dumps(camera.frame, ensure_ascii=False)}",
        f"lidar_frame: {json.dumps(camera.lidar_frame, ensure_ascii=False)}",
        *_matrix("T_camera_lidar", camera.T_camera_lidar.matrix),
    ]
    return "\n".join([*lines, ""])


FORMAT = Format(
    name="opencv",
    title="OpenCV",
    write=each_camera({"{}.yaml": _camera}),
    kind="yaml",
    direction="T_camera_lidar maps LiDAR points into the camera",
)
