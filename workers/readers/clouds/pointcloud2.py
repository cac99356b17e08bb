"""Columns of a ``sensor_msgs/PointCloud2``: any order of fields, offsets, padding and byte order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

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


def cloud_columns(cloud: PointCloud2, where: str) -> dict[str, NDArray[np.generic]]:
    """One (height * width,) array per scalar field, in the order of the fields; views into the message.

    Args:
        cloud: the message.
        where: names the message in errors.

    Raises:
        MessageError: ``cloud_empty``; ``cloud_malformed``, sizes that contradict each other.
    """
    step, width, height = cloud.point_step, cloud.width, cloud.height
    if width * height == 0:
        raise empty_cloud(where)
    scalars = [f for f in cloud.fields if f.datatype in _FORMATS and f.count == 1]
    formats = [(">" if cloud.is_bigendian else "<") + _FORMATS[f.datatype] for f in scalars]
    for field, form in zip(scalars, formats, strict=True):
        if field.offset + np.dtype(form).itemsize > step:
            raise _malformed(
                where, f"field {field.name!r} at byte {field.offset} does not fit in {step} bytes per point"
            )
    if len({field.name for field in scalars}) != len(scalars):
        raise _malformed(where, "it names a field twice")
    if width * height > MAX_POINTS:
        raise _malformed(where, f"it claims {width} x {height} points")
    # Some drivers leave row_step at 0 in clouds of one row.
    row_step = cloud.row_step if height > 1 else width * step
    if row_step < width * step or height * row_step > len(cloud.data):
        raise _malformed(
            where, f"{len(cloud.data)} bytes do not hold {height} rows of {width} points of {step} bytes"
        )
    if not scalars or step == 0:
        raise _malformed(where, "its points have no fields")
    dtype = np.dtype(
        {
            "names": [f.name for f in scalars],
            "formats": formats,
            "offsets": [f.offset for f in scalars],
            "itemsize": step,
        }
    )
    rows = np.asarray(cloud.data, np.uint8)[: height * row_step].reshape(height, row_step)[:, : width * step]
    points = np.ascontiguousarray(rows).reshape(-1).view(dtype)
    return {name: points[name] for name in dtype.names or ()}
