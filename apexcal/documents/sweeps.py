"""A sweep of the LiDAR as it is stored and sent: compact, little-endian, the same bytes for every reader.

The body is one gzip member. Unpacked it holds a header of 36 bytes, then for each ring how many points it has
(uint32), then columns of ``points`` entries each, ordered by ring and within a ring as the sensor gave them:

    x, y, z     3 bytes each: steps of ``position_step_m``, LiDAR frame
    intensity   2 bytes: steps of ``intensity_step``
    time        3 bytes: steps of ``time_step_ns``, relative to the sweep's stamp

A column of b bytes is b planes of one byte, the lowest first. Positions and times are stored as first differences
modulo 2^24, folded so that small differences of either sign give small numbers: 0, -1, 1, -2, ... become 0, 1, 2, 3.
Number and stamp of a sweep stand in the list of sweeps: they are known when the whole recording was read.
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple, Self

from apexcal.documents.base import Sent

MEDIA_TYPE: Final = "application/vnd.apexcal.sweep+gzip"
MAGIC: Final = b"APXS"
LAYOUT: Final = 2
_HEADER: Final = struct.Struct("<4sHHIddd")
HEADER_BYTES: Final = _HEADER.size
BYTES_PER_POINT: Final = 3 * 3 + 2 + 3

# A tenth of the finest step among the sensors that are read: 1 mm of an Ouster's range (its manual).
POSITION_STEP_M: Final = 0.0001
# For points farther than 838 m, which 24 bits of the fine step do not hold.
COARSE_STEP_M: Final = 0.001
# Velodyne packets count time in microseconds.
TIME_STEP_NS: Final = 1000.0


class SweepHeader(NamedTuple):
    """The header before a sweep's columns. A point's ring follows from the counts behind the header."""

    rings: int
    points: int
    position_step_m: float = POSITION_STEP_M
    intensity_step: float = 1.0
    time_step_ns: float = TIME_STEP_NS

    def pack(self) -> bytes:
        """The header's bytes."""
        return _HEADER.pack(MAGIC, LAYOUT, *self)

    @classmethod
    def unpack(cls, data: bytes) -> Self:
        """Back from :meth:`pack`. Raises ValueError for another layout."""
        if len(data) < HEADER_BYTES:
            raise ValueError("not a sweep: it ends within its header")
        magic, layout, *rest = _HEADER.unpack_from(data)
        if magic != MAGIC or layout != LAYOUT:
            raise ValueError(f"not a sweep of layout {LAYOUT}: it begins with {bytes(data[:6])!r}")
        return cls(*rest)


class SweepView(Sent):
    """A sweep of the LiDAR; ``length`` is how many bytes its points take over the wire."""

    index: int
    stamp_ns: int
    points: int
    length: int
