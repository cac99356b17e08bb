"""Sweeps of the LiDAR as arrays, from the bytes that are stored and sent."""

from __future__ import annotations

import gzip
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.sweeps import BYTES_PER_POINT, HEADER_BYTES, SweepHeader


class Points(NamedTuple):
    """A sweep's N points, ordered by ring and within a ring as the sensor gave them.

    ``xyz`` (N, 3) float32 in metres in the LiDAR frame, ``ring`` (N,) uint16, 0 the lowest, ``intensity`` (N,)
    float32, ``offset_ns`` (N,) int64 nanoseconds after the sweep's stamp, which stands in the list of sweeps.
    """

    header: SweepHeader
    xyz: NDArray[np.float32]
    ring: NDArray[np.uint16]
    intensity: NDArray[np.float32]
    offset_ns: NDArray[np.int64]


def unpack(data: bytes) -> Points:
    """The points of a packed sweep. Raises ValueError for bytes that are none."""
    return points_of(gzip.decompress(data))


def points_of(body: bytes) -> Points:
    """The points of a packed sweep whose gzip member is unpacked. Raises ValueError for bytes that are none."""
    header = SweepHeader.unpack(body)
    start, count = HEADER_BYTES + 4 * header.rings, header.points
    if len(body) != start + BYTES_PER_POINT * count:
        raise ValueError(f"a sweep of {count} points on {header.rings} rings does not take {len(body)} bytes")
    counts = np.frombuffer(body, "<u4", header.rings, HEADER_BYTES)
    ring = np.repeat(np.arange(header.rings, dtype=np.uint16), counts)
    if len(ring) != count:
        raise ValueError(f"the rings of a sweep of {count} points have {len(ring)}")
    planes = np.frombuffer(body, np.uint8, BYTES_PER_POINT * count, start).reshape(BYTES_PER_POINT, count)
    xyz = np.empty((count, 3), np.float32)
    for axis in range(3):
        np.multiply(
            _unfolded(planes[3 * axis : 3 * axis + 3]), header.position_step_m, xyz[:, axis], casting="unsafe"
        )
    intensity = (_joined(planes[9:11]) * header.intensity_step).astype(np.float32)
    offset_ns = _unfolded(planes[11:14]) * np.int64(header.time_step_ns)
    return Points(header, xyz, ring, intensity, offset_ns)


def _joined(planes: NDArray[np.uint8]) -> NDArray[np.int32]:
    """(N,) numbers of planes (B, N) of their bytes, the lowest first."""
    numbers = planes[0].astype(np.int32)
    for byte, plane in enumerate(planes[1:], start=1):
        numbers |= plane.astype(np.int32) << 8 * byte
    return numbers


def _unfolded(planes: NDArray[np.uint8]) -> NDArray[np.int32]:
    """(N,) the sums of folded differences modulo 2^24. In place: it is a good part of what a detection reads."""
    values = _joined(planes)
    signs = -(values & 1)
    values >>= 1
    values ^= signs
    np.cumsum(values, out=values)
    values <<= 8
    values >>= 8
    return values
