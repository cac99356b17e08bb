"""Camera intrinsics as people keep them in files, read into what a calibration request takes.

ROS: the YAML of ``camera_calibration`` and of a ``CameraInfo`` message. Kalibr: a camchain. OpenCV: the YAML of its
``FileStorage``. JSON is YAML too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from apexcal.errors import InputError
from apexcal.transport import Document

_LARGEST_BYTES = 1_000_000
_OPENCV_HEAD = "%YAML:"  # no YAML directive, so parsers refuse it
_FORMS = (
    "Known are OpenCV's FileStorage (image_width, image_height, camera_matrix, distortion_coefficients), the YAML of "
    "ROS (image_width, camera_matrix, distortion_model, distortion_coefficients; or a CameraInfo's width, height, "
    "distortion_model, K, D) and a Kalibr camchain (cam0: camera_model, intrinsics, ...)."
)


class _Loader(yaml.SafeLoader):
    """Also takes OpenCV's matrices, as mappings with ``data``."""


_Loader.add_constructor(  # pyright: ignore[reportUnknownMemberType]
    "tag:yaml.org,2002:opencv-matrix", _Loader.construct_yaml_map
)


def read_intrinsics(path: Path, camera: str) -> Document:
    """A camera's lens, as ``{"width", "height", "distortion_model", "K", "D"}``; a camchain is asked by its name.

    What the numbers mean is checked by the service. Raises :class:`InputError` where the file holds no such lens.
    """
    document = _first_document(path)
    chain = {name: one for name, one in document.items() if isinstance(one, Mapping) and "camera_model" in one}
    if chain:
        return _from_kalibr(path, _member(path, chain, camera))
    try:
        return _from_ros(path, document)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise InputError(f"{path} holds no intrinsics of a camera", _FORMS) from None


def _first_document(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise InputError(f"{path} is too large for a camera's intrinsics", _FORMS)
        # A message that was echoed ends with `---`.
        text = path.read_text(encoding="utf-8")
        opencv = text.startswith(_OPENCV_HEAD)
        if opencv:
            text = text.partition("\n")[2]
        document = next(iter(yaml.load_all(text, Loader=_Loader)), None)
    except OSError as error:
        raise InputError(f"cannot read {path}: {(error.strerror or '').lower()}") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as error:
        reason = str(getattr(error, "problem", None) or type(error).__name__)
        raise InputError(f"{path} is no YAML: {reason}", _FORMS) from None
    if not isinstance(document, Mapping):
        raise InputError(f"{path} holds no intrinsics of a camera", _FORMS)
    if opencv:  # these files say at most whether the model is that of cv2.fisheye
        return {"distortion_model": "equidistant" if document.get("fisheye_model") else "plumb_bob", **document}
    return document


def _from_ros(path: Path, document: Mapping[str, Any]) -> Document:
    matrix = next(name for name in ("camera_matrix", "K", "k") if name in document or name == "k")
    distortion = next(name for name in ("distortion_coefficients", "D", "d") if name in document or name == "d")
    K, D = document.get(matrix), document.get(distortion, [])
    return {
        "width": int(document["image_width"] if "image_width" in document else document["width"]),
        "height": int(document["image_height"] if "image_height" in document else document["height"]),
        "distortion_model": str(document["distortion_model"]),
        "K": _numbers(path, matrix, K["data"] if isinstance(K, Mapping) else K),
        "D": _numbers(path, distortion, D["data"] if isinstance(D, Mapping) else D),
    }


def _member(path: Path, chain: Mapping[str, Mapping[str, Any]], camera: str) -> Mapping[str, Any]:
    """The camera of a camchain: by its own name, by a part of its topic, or the only one."""
    named = [one for name, one in chain.items() if camera in (name, *str(one.get("rostopic", "")).split("/"))]
    found = named or (list(chain.values()) if len(chain) == 1 else [])
    if len(found) != 1:
        raise InputError(
            f"{path} has the cameras {', '.join(chain)}, and none of them is clearly {camera}",
            "Give a file with that camera alone.",
        )
    return found[0]


def _from_kalibr(path: Path, camera: Mapping[str, Any]) -> Document:
    if camera["camera_model"] != "pinhole":
        raise InputError(
            f"{path}: Kalibr's camera model {camera['camera_model']!r} has no equal here",
            "Calibrate as pinhole-radtan or pinhole-equi.",
        )
    try:
        f_x, f_y, c_x, c_y = _numbers(path, "intrinsics", camera["intrinsics"])
        width, height = (int(size) for size in camera["resolution"])
        model = str(camera["distortion_model"])
        D = _numbers(path, "distortion_coeffs", camera["distortion_coeffs"])
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError(f"{path} holds no complete camera of a Kalibr camchain", _FORMS) from None
    return {
        "width": width,
        "height": height,
        "distortion_model": model,
        "K": [f_x, 0.0, c_x, 0.0, f_y, c_y, 0.0, 0.0, 1.0],
        "D": D,
    }


def _numbers(path: Path, field: str, values: Any) -> list[float]:
    numbers = [float(value) for value in values]
    strange = next((number for number in numbers if not math.isfinite(number)), None)
    if strange is not None:
        raise InputError(f"{path}: {field} holds {strange}", "Every number in it must be a finite number.")
    return numbers
