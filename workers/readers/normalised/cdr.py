"""The two messages of a normalised recording in CDR (ROS 2's wire format), written and read by rosbags."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import ReadError, Sweep, TimeSource
from workers.readers.ros.ros_types import CLOUD, COMPRESSED, fixed_types

# 24 bytes a point: every field aligned, so that NumPy copies columns at full speed.
POINT_DTYPE: Final = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "offset_ns", "ring"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<i4", "<u2"],
        "offsets": [0, 4, 8, 12, 16, 20],
        "itemsize": 24,
    }
)
_FIELDS: Final = (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("offset_ns", 16, 5), ("ring", 20, 4))


def _written(kind: str, stamp_ns: int, frame_id: str, *fields: Any) -> memoryview:
    store = fixed_types("cdr")
    time = store.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
    header = store.types["std_msgs/msg/Header"](time, frame_id)
    return store.serialize_cdr(store.types[kind](header, *fields), kind)


def point_bytes(sweep: Sweep) -> NDArray[np.uint8]:
    """A sweep's points laid out as :data:`POINT_DTYPE`.

    Raises:
        OverflowError: a point lies more than 2.1 s from its sweep's stamp.
    """
    n = len(sweep.xyz)
    points = np.zeros(n, POINT_DTYPE)
    for axis, name in enumerate("xyz"):
        points[name] = sweep.xyz[:, axis]
    points["intensity"] = sweep.intensity
    points["ring"] = sweep.ring
    if n and max(abs(int(sweep.offset_ns.min())), abs(int(sweep.offset_ns.max()))) >= 2**31:
        raise OverflowError("a point lies more than 2.1 s from the stamp of its sweep")
    points["offset_ns"] = sweep.offset_ns
    return points.view(np.uint8)


def encode_points(sweep: Sweep, frame_id: str) -> memoryview:
    """A sweep as ``sensor_msgs/msg/PointCloud2`` without points that are no returns, laid out as :data:`POINT_DTYPE`.

    Raises:
        OverflowError: a point lies more than 2.1 s from its sweep's stamp.
    """
    points = point_bytes(sweep)
    field = fixed_types("cdr").types["sensor_msgs/msg/PointField"]
    fields = [field(*each, 1) for each in _FIELDS]
    layout = (False, POINT_DTYPE.itemsize, len(points), points, True)
    return _written(CLOUD, sweep.stamp_ns, frame_id, 1, len(sweep.xyz), fields, *layout)


def decode_points(message: bytes | memoryview, time_source: TimeSource) -> Sweep:
    """A message of :func:`encode_points` as a :class:`Sweep`; every array is a fresh, contiguous copy.

    Raises:
        ReadError: ``not_normalised``, the message has another layout.
    """
    cloud: Any = fixed_types("cdr").deserialize_cdr(message, CLOUD)
    if tuple((field.name, field.offset, field.datatype) for field in cloud.fields) != _FIELDS:
        raise ReadError(
            "not_normalised",
            "The point clouds in this file do not have the layout that apexcal writes.",
            "Give the original recording to the ingestion instead of a file that another program wrote.",
        )
    points = cloud.data.view(POINT_DTYPE)
    # Copied as one item of 12 bytes a point, faster than as numbers.
    together = np.ndarray((len(points),), "V12", cloud.data, 0, (POINT_DTYPE.itemsize,))
    stamp = cloud.header.stamp
    return Sweep(
        stamp_ns=stamp.sec * 1_000_000_000 + stamp.nanosec,
        xyz=together.copy().view("<f4").reshape(-1, 3),
        intensity=points["intensity"].copy(),
        ring=points["ring"].copy(),
        offset_ns=points["offset_ns"].astype(np.int64),
        time_source=time_source,
    )


def encode_image(stamp_ns: int, frame_id: str, media_type: str, data: bytes) -> memoryview:
    """An encoded image as ``sensor_msgs/msg/CompressedImage``, which its bytes end."""
    kind = media_type.removeprefix("image/")
    return _written(COMPRESSED, stamp_ns, frame_id, kind, np.frombuffer(data, np.uint8))
