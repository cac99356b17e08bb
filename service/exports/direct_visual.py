"""``calib.json`` of direct_visual_lidar_calibration: lens and ``T_lidar_camera`` as x y z qx qy qz qw."""

from __future__ import annotations

import json

from service.exports.calibrated import CalibratedCamera
from service.exports.format import WITHOUT_RATIONAL, Format, each_camera, numbers


def _document(camera: CalibratedCamera) -> str:
    (f_x, _, c_x), (_, f_y, c_y), _ = camera.K
    pose = camera.T_lidar_camera
    document = {
        "camera": {
            "camera_model": camera.written_as.camera_info,
            "distortion_coeffs": numbers(camera.D),
            "intrinsics": numbers([f_x, f_y, c_x, c_y]),
        },
        "meta": {"image_topic": camera.topic or ""},
        "results": {"T_lidar_camera": numbers([*pose.t, *pose.quaternion_xyzw])},
    }
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


FORMAT = Format(
    name="direct_visual",
    title="direct_visual_lidar_calibration",
    write=each_camera({"{}/calib.json": _document}),
    lenses=WITHOUT_RATIONAL,
    kind="zip",
    direction="T_lidar_camera maps the camera's points into the LiDAR",
)
