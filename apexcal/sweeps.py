"""Sweeps of the LiDAR as arrays, from the bytes that the service sends."""

from __future__ import annotations

import gzip
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.sweeps import HEADER_BYTES, SweepHeader


class Points(NamedTuple):
    """A sweep's points, ordered by ring and within a ring as the sensor gave them.

    ``xyz`` (N, 3) float64 in metres in the LiDAR frame, ``ring`` (N,) uint16, 0 the lowest, ``intensity`` (N,)
    float64, ``time_ns`` (N,) int64 UTC nanoseconds.
    """

    header: SweepHeader
    xyz: NDArray[np.float64]
    ring: NDArray[np.uint16]
    intensity: NDArray[np.float64]
    time_ns: NDArray[np.int64]


def unpack(data: bytes) -> Points:
    """The points of a packed sweep. Raises ValueError for bytes that are none."""
    body = gzip.decompress(data)
    header = SweepHeader.unpack(body)
    counts = np.frombuffer(body, "<u4", header.rings, HEADER_BYTES)
    columns = _Columns(body, HEADER_BYTES + counts.nbytes, header.points)
    xyz = np.column_stack([columns.unfolded() for _ in range(3)]).astype(np.float64) * header.position_step_m
    intensity = columns.planes(2).astype(np.float64) * header.intensity_step
    time_ns = header.stamp_ns + np.rint(columns.unfolded() * header.time_step_ns).astype(np.int64)
    return Points(header, xyz, np.repeat(np.arange(header.rings, dtype=np.uint16), counts), intensity, time_ns)


class _Columns:
    """Reads column after column."""

    def __init__(self, body: bytes, at: int, count: int) -> None:
        self._body, self._at, self._count = body, at, count

    def planes(self, count: int) -> NDArray[np.int64]:
        """(N,) numbers of ``count`` bytes each."""
        planes = np.frombuffer(self._body, np.uint8, count * self._count, self._at).reshape(count, -1)
        self._at += planes.size
        return (planes.astype(np.int64) << (8 * np.arange(count))[:, None]).sum(axis=0)

    def unfolded(self) -> NDArray[np.int64]:
        """(N,) the sums of folded differences modulo 2^24."""
        folded = self.planes(3)
        total = np.cumsum((folded >> 1) ^ -(folded & 1))
        return (total + 2**23) % 2**24 - 2**23
