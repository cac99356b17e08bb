"""Intrinsics that a recording states, as a starting guess in our models' names."""

from __future__ import annotations

import math
import posixpath
from collections.abc import Mapping, Sequence
from typing import Any, Final

from apexcal.documents.lenses import coefficients_of, model_stated
from workers.readers.ros.topic_messages import CameraInfo

_IMAGE_SUFFIXES: Final = ("/compressed", "/raw")


def camera_info(
    stamp_ns: int, frame_id: str, width: int, height: int, model: str, d: Sequence[float], k: Sequence[float]
) -> CameraInfo:
    """A message's fields, numbers made Python's own."""
    numbers = ([float(value) for value in d], [float(value) for value in k])
    return CameraInfo(stamp_ns, frame_id, int(width), int(height), str(model), *numbers)


def info_document(info: CameraInfo) -> dict[str, Any] | None:
    """What is handed on of a camera's intrinsics; None where the camera was not calibrated or the numbers are none.

    ``D`` has as many coefficients as our model: five for ``brown_conrady`` (OpenCV's k1 k2 p1 p2 k3), four for
    ``kannala_brandt``. A model with more that matter (rational, thin prism) has no equal here, and ``model`` is None.
    """
    if len(info.k) != 9 or not all(math.isfinite(value) for value in (*info.k, *info.d)):
        return None
    if info.k[0] <= 0 or info.k[4] <= 0:
        return None
    model = model_stated(info.distortion_model)
    D = coefficients_of(model, info.d) if model else None
    return {
        "model": model if D is not None else None,
        "K": list(info.k),
        "D": list(info.d) if D is None else D,
        "distortion_model": info.distortion_model[:64],
        "width": info.width,
        "height": info.height,
    }


def match_infos(cameras: Mapping[str, str], infos: Mapping[str, CameraInfo]) -> dict[str, CameraInfo]:
    """The intrinsics of each camera topic: its neighbour in the namespace, else the only one of its frame.

    Args:
        cameras: topic and frame_id of each camera.
        infos: topic and first message of each topic of intrinsics.
    """
    found: dict[str, CameraInfo] = {}
    for topic, frame_id in cameras.items():
        plain = topic
        for suffix in _IMAGE_SUFFIXES:
            plain = plain.removesuffix(suffix)
        beside = [info for name, info in infos.items() if posixpath.dirname(name) == posixpath.dirname(plain)]
        named = [info for name, info in infos.items() if name in (f"{topic}/camera_info", f"{plain}/camera_info")]
        framed = [info for info in infos.values() if frame_id and info.frame_id == frame_id]
        for candidates in (named, beside, framed):
            if len(candidates) == 1:
                found[topic] = candidates[0]
                break
    return found
