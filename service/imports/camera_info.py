"""ROS: the YAML of ``camera_calibration``, and a ``CameraInfo`` message as it is echoed. The lens alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.imports.contents import Contents, FileCamera, FileLens, image_size, numbers, refused
from service.imports.members import without_distortion


def is_camera_info(document: Mapping[str, Any]) -> bool:
    """Whether the file says a distortion model and a camera matrix as ROS does."""
    return "distortion_model" in document and _first(document, "camera_matrix", "K", "k") is not None


def read_camera_info(name: str, document: Mapping[str, Any]) -> Contents:
    """Raises :class:`Problem` 422 ``calibration_file_not_read``."""
    width, height = (_first(document, *names) for names in (("image_width", "width"), ("image_height", "height")))
    if width is None or height is None:
        raise refused(f"{name} says no image size.", "It has image_width and image_height, or width and height.")
    K = numbers(f"K of {name}", _first(document, "camera_matrix", "K", "k"), 9)
    stated = _first(document, "distortion_coefficients", "D", "d")
    if stated is None and document["distortion_model"] not in ("none", ""):
        raise without_distortion(name, document)
    D = numbers(f"D of {name}", stated or [])
    lens = FileLens(str(document["distortion_model"])[:64], K, D, image_size(f"The images of {name}", width, height))
    notes: list[str] = []
    R = _first(document, "rectification_matrix", "R", "r")
    if R is not None and numbers(f"R of {name}", R) not in ([1, 0, 0, 0, 1, 0, 0, 0, 1], [0] * 9):
        notes.append("The file rectifies (R is not the identity). K and D are for the images as recorded.")
    return Contents([FileCamera(str(document.get("camera_name") or "camera")[:200], lens=lens)], notes=notes)


def _first(document: Mapping[str, Any], *names: str) -> Any:
    return next((document[name] for name in names if document.get(name) is not None), None)
