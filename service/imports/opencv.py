"""OpenCV's FileStorage in YAML or JSON: K, D and size under the names that its samples and calibrators use.

Files that we wrote also hold ``T_camera_lidar``; no other name of a transform says its direction, but for the R and T
of stereoCalibrate, which map points of the first camera into the second.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from apexcal.geometry.se3 import SE3
from service.imports.contents import (
    LIDAR,
    Contents,
    FileCamera,
    FileLens,
    image_size,
    matrix,
    numbers,
    refused,
    transform,
)

_K = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "CameraMatrix", "CameraMat", "K")
_D = ("distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "DistCoeff", "D")
_SIZES = (("image_width", "image_height"), ("image_Width", "image_Height"), ("width", "height"))
_UNDIRECTED = ("R", "T", "rvec", "tvec", "extrinsic_parameters", "CameraExtrinsicMat")
_LISTED = ("ImageSize", "image_size", "imageSize")
# Told by calibrateCamera: 4, 5, 8, 12 or 14 coefficients.
_RATIONAL_FROM = 8


def is_opencv(document: Mapping[str, Any]) -> bool:
    """Whether it has a matrix as FileStorage writes them."""
    matrix = next((document[name] for name in _K if name in document), None)
    return isinstance(matrix, dict) and {"rows", "cols", "data"} <= set(matrix)


def is_opencv_stereo(document: Mapping[str, Any]) -> bool:
    """Whether it has the matrices of two cameras as OpenCV's stereo_calib names them."""
    return {"M1", "M2"} <= set(document)


def read_opencv_stereo(name: str, document: Mapping[str, Any]) -> Contents:
    """``intrinsics.yml`` (M1, D1, M2, D2), with ``extrinsics.yml`` (R, T) or alone; neither has the size.

    Raises:
        Problem: 422 ``calibration_file_not_read``.
    """
    cameras: list[FileCamera] = []
    for number in "12":
        D = numbers(f"D{number} of {name}", document.get(f"D{number}", []))
        K = numbers(f"M{number} of {name}", document[f"M{number}"], 9)
        cameras.append(FileCamera(number, lens=FileLens(_model_of(D), K, D, _size(name, document))))
    if not {"R", "T"} <= set(document):
        return Contents(cameras)
    R = matrix(f"R of {name}", document["R"], 3, 3)
    return Contents(cameras, [transform("2", "1", R, matrix(f"T of {name}", document["T"], 3))])


def read_opencv(name: str, document: Mapping[str, Any]) -> Contents:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    K = next((key for key in _K if key in document), None)
    if K is None:
        raise refused(f"{name} has no camera matrix ({', '.join(_K)}).", "Send the file with the camera's lens.")
    D = next((key for key in _D if key in document), None)
    coefficients = numbers(f"{D} of {name}", document[D]) if D else []
    fisheye = bool(document.get("fisheye_model", 0))
    model = "equidistant" if fisheye else _model_of(coefficients)
    lens = FileLens(model, numbers(f"{K} of {name}", document[K], 9), coefficients, _size(name, document))
    notes = (
        [] if "fisheye_model" in document else ["The file does not say fisheye_model, so it is not cv2.fisheye's."]
    )
    others = [key for key in document if key in _UNDIRECTED]
    if others:
        notes.append(f"{', '.join(others)}: the file does not state its direction, so it was left out.")
    return Contents([FileCamera("camera", lens=lens, T_camera_lidar=_mount(name, document))], notes=notes)


def _model_of(coefficients: list[float]) -> str:
    return "plumb_bob" if len(coefficients) < _RATIONAL_FROM else "rational_polynomial"


def _size(name: str, document: Mapping[str, Any]) -> tuple[int, int] | None:
    for width, height in _SIZES:
        if width in document and height in document:
            return image_size(f"The images of {name}", document[width], document[height])
    listed = next((document[key] for key in _LISTED if key in document), None)
    return None if listed is None else image_size(f"The images of {name}", *numbers(f"The size in {name}", listed, 2))


def _mount(name: str, document: Mapping[str, Any]) -> SE3 | None:
    if "T_camera_lidar" not in document:
        return None
    T = matrix(f"T_camera_lidar of {name}", document["T_camera_lidar"], 4, 4)
    to_frame, from_frame = str(document.get("camera_frame") or "camera"), str(document.get("lidar_frame") or LIDAR)
    return transform(to_frame[:200], from_frame[:200], T[:3, :3], T[:3, 3])
