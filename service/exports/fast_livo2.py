"""FAST-LIVO2: the part ``extrin_calib`` of its configuration and vikit's camera file, a folder for each camera."""

from __future__ import annotations

from service.exports.calibrated import CalibratedCamera
from service.exports.format import WITHOUT_RATIONAL, Format, each_camera, yaml_list, yaml_number


def _extrinsics(camera: CalibratedCamera) -> str:
    T = camera.T_camera_lidar
    return f"extrin_calib:\n  Rcl: {yaml_list(T.R)}\n  Pcl: {yaml_list(T.t)}\n"


def _lens(camera: CalibratedCamera) -> str:
    """Pinhole takes d0 to d3 as k1 k2 p1 p2, EquidistantCamera k1 to k4."""
    fisheye = camera.written_as.is_cv2_fisheye
    terms = ("k1", "k2", "k3", "k4") if fisheye else ("cam_d0", "cam_d1", "cam_d2", "cam_d3")
    (f_x, _, c_x), (_, f_y, c_y), _ = camera.K
    values = {"scale": 1.0, "cam_fx": f_x, "cam_fy": f_y, "cam_cx": c_x, "cam_cy": c_y}
    values |= dict(zip(terms, camera.D, strict=False))
    lines = [
        f"cam_model: {'EquidistantCamera' if fisheye else 'Pinhole'}",
        f"cam_width: {camera.width}",
        f"cam_height: {camera.height}",
        *(f"{name}: {yaml_number(value)}" for name, value in values.items()),
    ]
    return "\n".join([*lines, ""])


FORMAT = Format(
    name="fast_livo2",
    title="FAST-LIVO2",
    write=each_camera({"{}/extrinsics.yaml": _extrinsics, "{}/camera.yaml": _lens}),
    lenses=WITHOUT_RATIONAL,
    kind="zip",
    direction="Rcl, Pcl map LiDAR points into the folder's camera",
    third_radial=False,
    mount_apart=True,
)
