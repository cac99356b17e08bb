"""Kalibr's camchain: lenses, and each camera's transform from the one before it. A camchain has no LiDAR."""

from __future__ import annotations

import json

from service.exports.calibrated import Calibrated, CalibratedCamera
from service.exports.format import WITHOUT_RATIONAL, Files, Format, yaml_list


def _camera(index: int, camera: CalibratedCamera, before: CalibratedCamera | None) -> list[str]:
    (f_x, _, c_x), (_, f_y, c_y), _ = camera.K
    lines = [
        f"cam{index}:",
        "  camera_model: pinhole",
        f"  intrinsics: {yaml_list([f_x, f_y, c_x, c_y])}",
        f"  distortion_model: {camera.written_as.kalibr}",
        f"  distortion_coeffs: {yaml_list(camera.D[:4])}",
        f"  resolution: [{camera.width}, {camera.height}]",
        f"  rostopic: {json.dumps(camera.topic or f'/{camera.name}/image_raw', ensure_ascii=False)}",
    ]
    if before is None:
        return lines
    chained = camera.T_camera_lidar @ before.T_camera_lidar.inverse()
    return [*lines, "  T_cn_cnm1:", *(f"  - {yaml_list(row)}" for row in chained.matrix)]


def _files(calibrated: Calibrated) -> Files:
    lines: list[str] = []
    before: CalibratedCamera | None = None
    for index, camera in enumerate(calibrated.cameras):
        lines += _camera(index, camera, before)
        before = camera
    return {"camchain.yaml": "\n".join([*lines, ""])}


FORMAT = Format(
    name="kalibr",
    title="Kalibr",
    write=_files,
    lenses=WITHOUT_RATIONAL,
    kind="yaml",
    direction="T_cn_cnm1 maps points of the camera before into this one; the LiDAR's mount is not in it",
    third_radial=False,
    one_lidar=True,
)
