"""Intrinsics that a recording states, as a starting guess in our models' names."""

from __future__ import annotations

import math
import posixpath
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from apexcal.documents.bounds import LEAST_FOCAL_PX
from apexcal.documents.lenses import lens_of_images, model_of_lens
from apexcal.documents.name_words import words
from apexcal.documents.readings import ImageKind
from workers.readers.clouds.pointcloud2 import PointCloud2
from workers.readers.ros.topic_messages import CameraInfo, CloudMessage, Message, PacketMessage, RawImage
from workers.readers.topic_words import bare_topic

_RECTIFIED: Final = frozenset(("rect", "rectified", "undistorted"))
# image_proc's names of images that it did not rectify.
_RAW: Final = ("image_color", "image_mono")


def matrices_of(message: Any) -> tuple[Any, Any, Any, Any]:
    """D, K, R and P of a message of intrinsics; ROS 2 has no names in capitals."""
    d, k, r, p = (getattr(message, name) for name in ("DKRP" if hasattr(message, "K") else "dkrp"))
    return d, k, r, p


def camera_info(
    stamp_ns: int, frame_id: str, width: int, height: int, model: str, *dkrp: Sequence[float]
) -> CameraInfo:
    """A message's fields, numbers made Python's own. ``dkrp``: D, K, R and P."""
    d, k, r, p = ([float(value) for value in matrix] for matrix in dkrp)
    return CameraInfo(stamp_ns, frame_id, int(width), int(height), str(model), d, k, r, p)


def info_document(info: CameraInfo, image_size: tuple[int, int] | None = None) -> dict[str, Any] | None:
    """Return a camera's intrinsics as they are handed on; None if they are not calibrated or not finite.

    They are those of the images, not of the whole sensor, of which a driver may hand on a part, or pixels put
    together (``roi`` and ``binning`` of the message). ``image_size``: width and height of the images, where known.

    ``D`` has as many coefficients as our model: five for ``brown_conrady`` (OpenCV's k1 k2 p1 p2 k3), four for
    ``kannala_brandt``, eight for ``rational_polynomial``. A model with more that matter (thin prism) has no equal
    here, and ``model`` is None.
    """
    if len(info.k) != 9 or not all(math.isfinite(value) for value in (*info.k, *info.d)):
        return None
    if min(info.k[0], info.k[4]) <= LEAST_FOCAL_PX:  # 0, or the identity, before a driver has its calibration
        return None
    info = _of_images(info, image_size)
    model, D = model_of_lens(info.distortion_model, info.d)
    is_rectifying = len(info.p) == 12 and all(map(math.isfinite, info.p)) and info.p[0] > 0 and info.p[5] > 0
    return {
        "model": model if D is not None else None,
        "K": list(info.k),
        "D": list(info.d) if D is None else D,
        "R": _turn(info.r) if is_rectifying else None,
        "P": list(info.p) if is_rectifying else None,
        "distortion_model": info.distortion_model[:64],
        "width": info.width,
        "height": info.height,
    }


def _of_images(info: CameraInfo, image_size: tuple[int, int] | None) -> CameraInfo:
    """Return the CameraInfo of images of which the sensor hands on a part, or pixels put together.

    The definition of sensor_msgs/CameraInfo has K and P for the whole sensor. Images of the whole sensor's size are
    none such, whatever is stated. A size of 0 is that of the images.
    """
    size = (info.width or (image_size or (0, 0))[0], info.height or (image_size or (0, 0))[1])
    offset, part = info.roi[:2], info.roi[2:] if all(info.roi[2:]) else size
    if info.width and image_size == size:
        return info
    sx, sy = (max(1, count) for count in info.binning)

    def centre(along: float, axis: int) -> float:
        """Return the centre in the image: a pixel that joins several has its centre in their middle."""
        return (along + 0.5 - offset[axis]) / (sx, sy)[axis] - 0.5

    k, p = list(info.k), list(info.p)
    k = [k[0] / sx, k[1] / sx, centre(k[2], 0), k[3], k[4] / sy, centre(k[5], 1), *k[6:]]
    if len(p) == 12:
        p = [p[0] / sx, p[1] / sx, centre(p[2], 0), p[3] / sx, p[4], p[5] / sy, centre(p[6], 1), p[7] / sy, *p[8:]]
    whole = (part[0] // sx, part[1] // sy) if info.width else image_size or (0, 0)
    return replace(info, width=whole[0], height=whole[1], k=k, p=p)


def is_filled(message: Message) -> bool:
    """Whether a message tells what its topic holds: points with fields, pixels, packets, a lens."""
    if isinstance(message, CameraInfo):
        return info_document(message) is not None
    if isinstance(message, CloudMessage):
        cloud = message.cloud
        if not isinstance(cloud, PointCloud2):
            return len(cloud["x"]) > 0
        return bool(cloud.fields) and cloud.width * cloud.height > 0
    if isinstance(message, RawImage):
        return message.width * message.height > 0
    return bool(message.packets if isinstance(message, PacketMessage) else message.data)


def _turn(r: Sequence[float]) -> list[float] | None:
    """R, unless it is no rotation, or none that a pixel shows."""
    # Fields of a file may hold any number.
    R = np.reshape(r, (3, 3)) if len(r) == 9 and all(abs(value) < 1.1 for value in r) else np.zeros((3, 3))
    is_rotation = np.allclose(R @ R.T, np.eye(3), atol=1e-3) and np.linalg.det(R) > 0.0
    return list(r) if is_rotation and not np.allclose(R, np.eye(3), atol=1e-5) else None


def image_kind(topic: str, info: Mapping[str, Any] | None) -> ImageKind | None:
    """Whether a topic's images are raw or rectified; None where neither its name nor its CameraInfo tells.

    ``info`` is that of :func:`info_document`.

    RealSense's ``image_rect_raw`` is rectified. A CameraInfo without distortion and rotation, whose P repeats its K,
    is that of rectified images: raw and rectified ones would be the same.
    """
    plain = without_transport(topic)
    if words(plain) & _RECTIFIED:
        return "rectified"
    if "raw" in words(last := posixpath.basename(plain)) or last in _RAW:
        return "raw"
    rectified = lens_of_images(info, "rectified") if info else None
    is_same = info and rectified and not any(info["D"]) and info["R"] is None and rectified["K"] == info["K"]
    return "rectified" if is_same else None


def without_transport(topic: str) -> str:
    """An image topic without the name that image_transport puts behind it."""
    return bare_topic(topic).removesuffix("/raw")


def match_infos(cameras: Mapping[str, str], infos: Mapping[str, CameraInfo]) -> dict[str, CameraInfo]:
    """The intrinsics of each camera topic: its neighbour in the namespace, else the only one of its frame.

    Args:
        cameras: topic and frame_id of each camera.
        infos: topic and first message of each topic of intrinsics.
    """
    matched: dict[str, CameraInfo] = {}
    for topic, frame_id in cameras.items():
        plain = without_transport(topic)
        beside = [info for name, info in infos.items() if posixpath.dirname(name) == posixpath.dirname(plain)]
        named = [info for name, info in infos.items() if name in (f"{topic}/camera_info", f"{plain}/camera_info")]
        framed = [info for info in infos.values() if frame_id and info.frame_id == frame_id]
        for candidates in (named, beside, framed):
            if len(candidates) == 1:
                matched[topic] = candidates[0]
                break
    return matched
