"""Livox's own cloud message, ``CustomMsg`` of its drivers, as columns; read as an array, 24,000 points at a time."""

from __future__ import annotations

import struct
from typing import Final

import numpy as np

from workers.readers.clouds.pointcloud2 import MAX_POINTS
from workers.readers.ros.topic_messages import CloudMessage

LIVOX_CLOUDS: Final = (
    "livox_ros_driver2/msg/CustomMsg",
    "livox_ros_driver/msg/CustomMsg",
    "livox_interfaces/msg/CustomMsg",
)
_POINT: Final = (
    *(("offset_time", "u4"), ("x", "f4"), ("y", "f4"), ("z", "f4")),
    *(("reflectivity", "u1"), ("tag", "u1"), ("line", "u1")),
)
_NAMES: Final = [name for name, _ in _POINT]
_OFFSETS: Final = [0, 4, 8, 12, 16, 17, 18]
_ROS1_STEP: Final = 19
_CDR_STEP: Final = 20  # each point begins at a multiple of 4
# Tag of a point (user manuals of HAP, Avia and Mid-70): bits 0 and 1 tell noise by place, 2 and 3 by intensity, 0
# normal, 1 and 2 noise of high and of moderate confidence. Bits 4 and 5 count returns.
_IS_NOISE: Final = np.array([any((tag >> shift) & 3 in (1, 2) for shift in (0, 2)) for tag in range(256)])


def read_livox_cloud(raw: bytes, encoding: str) -> CloudMessage:
    """A ``CustomMsg`` without the points that the sensor calls noise; ``encoding``: ``ros1`` or ``cdr``.

    Its times, ``time``, are nanoseconds of the sensor's clock: the message's base time and each point's offset.

    Raises:
        struct.error, ValueError: the message is cut short, or is another one.
    """
    is_ros1 = encoding == "ros1"
    order = "<" if is_ros1 or raw[1] & 1 else ">"
    origin = 4  # sequence number of ROS 1, encapsulation of CDR
    sec, nanosec, length = struct.unpack_from(f"{order}III", raw, origin)
    at = origin + 12 + length
    frame_id = bytes(raw[origin + 12 : at]).rstrip(b"\0").decode("utf-8", "replace")
    if not is_ros1:
        at += -(at - origin) % 8
    base_ns, _, count = struct.unpack_from(f"{order}QI4xI", raw, at)
    step = _ROS1_STEP if is_ros1 else _CDR_STEP
    start, end = at + 20, at + 20 + count * step
    # CDR does not fill up the last point.
    if count > MAX_POINTS or len(raw) < end - (step - _ROS1_STEP) * bool(count):
        raise ValueError(f"{len(raw)} bytes do not hold {count} points")
    forms = [order + form for _, form in _POINT]
    layout = np.dtype({"names": _NAMES, "formats": forms, "offsets": _OFFSETS, "itemsize": step})
    points = np.frombuffer(bytes(raw[start:end]).ljust(count * step, b"\0"), layout)
    points = points[~_IS_NOISE[points["tag"]]]
    columns = {name: points[name] for name in ("x", "y", "z", "reflectivity", "line")}
    time = points["offset_time"].astype(np.int64) + (base_ns & (2**63 - 1))
    return CloudMessage(sec * 1_000_000_000 + nanosec, frame_id, {**columns, "time": time})
