"""Columns of a ``sensor_msgs/PointCloud2``: any order of fields, offsets, padding and byte order."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.clouds.fields import Columns, meanings
from workers.readers.recording import MessageError

# sensor_msgs/PointField: INT8 = 1 ... FLOAT64 = 8
_FORMATS: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
MAX_POINTS: Final = 20_000_000


@dataclass(frozen=True, slots=True)
class PointField:
    """``sensor_msgs/PointField``."""

    name: str
    offset: int
    datatype: int
    count: int = 1


@dataclass(frozen=True, slots=True)
class PointCloud2:
    """``sensor_msgs/PointCloud2`` without its header."""

    height: int
    width: int
    fields: Sequence[PointField]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: NDArray[np.uint8]


def _malformed(where: str, why: str) -> MessageError:
    return MessageError(
        "cloud_malformed",
        f"{where} is no valid point cloud: {why}.",
        "Record it again; look at the driver that publishes this topic.",
    )


def empty_cloud(where: str, count: int = 0) -> MessageError:
    """The reason to leave out a cloud of ``count`` points without a return."""
    return MessageError(
        "cloud_empty",
        f"{where} holds {f'{count} points, and none is a return' if count else 'no points'}.",
        "Look at the LiDAR's driver: was the sensor on, and does it send to this machine?",
    )


def cloud_columns(cloud: PointCloud2 | Columns, where: str) -> dict[str, NDArray[np.generic]]:
    """One (height * width,) array per field, in the order of the fields; views into the message.

    A field of several values a point is a (height * width, count) array. Some drivers fill in ``count`` and
    ``row_step`` at random, because their own readers pass over them: they count where they fit offsets and bytes.

    Args:
        cloud: the message, or its columns, which stay as they are.
        where: names the message in errors.

    Raises:
        MessageError: ``cloud_empty``; ``cloud_malformed``, sizes that contradict each other.
    """
    if isinstance(cloud, Mapping):
        return dict(cloud)
    step, width, height = cloud.point_step, cloud.width, cloud.height
    order = ">" if cloud.is_bigendian else "<"
    size = len(cloud.data)
    if height == 0 and step and width * step == size:
        height = 1
    if width * height == 0:
        raise empty_cloud(where)
    if width * height > MAX_POINTS:
        raise _malformed(where, f"it claims {width} x {height} points")
    ends = sorted({field.offset for field in cloud.fields} | {step})
    layout: dict[str, tuple[Any, int]] = {}
    for field in cloud.fields:
        if field.datatype not in _FORMATS:
            if field.name in ("x", "y", "z"):
                raise _malformed(
                    where, f"its field {field.name!r} has the datatype {field.datatype}; 1 to 8 are known"
                )
            continue
        kind = np.dtype(order + _FORMATS[field.datatype])
        if field.offset + kind.itemsize > step:
            raise _malformed(
                where,
                f"field {field.name!r} at byte {field.offset} does not fit in {step} bytes per point (point_step)",
            )
        end = ends[bisect_right(ends, field.offset)]
        is_array = 1 < field.count <= (end - field.offset) // kind.itemsize
        if field.name not in layout:
            layout[field.name] = ((kind, (field.count,)) if is_array else kind, field.offset)
        elif meanings([field.name]):
            raise _malformed(where, f"it names the field {field.name!r} twice")
    row_step = _row_step(cloud, width, height, where)
    if not layout or step == 0:
        raise _malformed(where, "its points have no fields")
    kinds, offsets = zip(*layout.values(), strict=True)
    dtype = np.dtype({"names": list(layout), "formats": kinds, "offsets": offsets, "itemsize": step})
    rows = np.asarray(cloud.data, np.uint8)[: height * row_step].reshape(height, row_step)[:, : width * step]
    points = np.ascontiguousarray(rows).reshape(-1).view(dtype)
    return {name: points[name] for name in dtype.names or ()}


def _row_step(cloud: PointCloud2, width: int, height: int, where: str) -> int:
    """Bytes from row to row: as stated where that fits, else those of a row's points where these are all bytes."""
    size, needed = len(cloud.data), width * cloud.point_step
    if height > 1 and cloud.row_step >= needed and height * cloud.row_step <= size:
        return cloud.row_step
    if size == height * needed or (height <= 1 and size >= needed):
        return needed
    raise _malformed(
        where,
        f"{size} bytes do not hold {height} rows of {width} points of {cloud.point_step} bytes (point_step), "
        f"{cloud.row_step} bytes from row to row (row_step)",
    )
