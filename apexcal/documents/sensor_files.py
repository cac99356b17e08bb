"""The layout of a sensor's file: sweeps or images end to end, facts as JSON, an index, and its last 32 bytes.

The index has one entry for each sweep or image in the order of the stamps, all of one size. So its place follows from
the file's size and their number, and nothing before it is read. Numbers are little-endian.
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

MAGIC: Final = b"APXF"
LAYOUT: Final = 1
# Where the facts begin, where the index begins, how many entries it has, the size of an entry, the layout, the magic.
TAIL: Final = struct.Struct("<QQIII4s")
# Stamp (UTC nanoseconds), offset and length of the packed sweep, number of its points.
SWEEP_ENTRY: Final = struct.Struct("<qqII")
# Stamp, offset and length of the encoded image, its width and height in pixels, its number in `MEDIA_TYPES`.
FRAME_ENTRY: Final = struct.Struct("<qqIIII")
MEDIA_TYPES: Final = ("image/jpeg", "image/png", "image/webp")


class SweepEntry(NamedTuple):
    """The place of a sweep in its file."""

    stamp_ns: int
    offset: int
    length: int
    points: int


def sweep_index_at(file_bytes: int, count: int) -> int:
    """Return where the index begins in a LiDAR's file of so many bytes and sweeps."""
    return file_bytes - TAIL.size - SWEEP_ENTRY.size * count
