"""The YAML of ROS's camera_calibration_parsers, as ``camera_info_url`` names it: the lens alone."""

from __future__ import annotations

from service.exports.calibrated import CalibratedCamera, file_name
from service.exports.format import Format, each_camera, yaml_list


def camera_info(camera: CalibratedCamera) -> str:
    """One camera. The rectified image is the undistorted one: R is the identity, P is K.

    Of rectified images this is the lens that they have already, in their own frame.
    """
    P = [entry for row in camera.K for entry in (*row, 0.0)]
    lines = [
        *([f"# Of rectified images, in the frame {camera.frame}."] if camera.is_rectified else []),
        f"image_width: {camera.width}",
        f"image_height: {camera.height}",
        f'camera_name: "{file_name(camera.name)}"',
        *_matrix("camera_matrix", 3, 3, [entry for row in camera.K for entry in row]),
        f"distortion_model: {camera.written_as.camera_info}",
        *_matrix("distortion_coefficients", 1, len(camera.D), camera.D),
        *_matrix("rectification_matrix", 3, 3, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        *_matrix("projection_matrix", 3, 4, P),
    ]
    return "\n".join(lines) + "\n"


def _matrix(name: str, rows: int, columns: int, data: list[float]) -> list[str]:
    return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: {yaml_list(data)}"]


FORMAT = Format(
    name="camera_info",
    title="ROS camera_info",
    write=each_camera({"{}.yaml": camera_info}),
    kind="yaml",
    direction="none: the lens alone",
)
