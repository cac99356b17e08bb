"""The two messages of a normalised recording in CDR (ROS 2's little-endian wire format), fixed layout."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import ReadError, Sweep, TimeSource

POINT_CLOUD_SCHEMA: Final = "sensor_msgs/msg/PointCloud2"
IMAGE_SCHEMA: Final = "sensor_msgs/msg/CompressedImage"

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
_ENCAPSULATION: Final = b"\x00\x01\x00\x00"  # plain CDR, little endian; alignment counts from behind it


def _aligned(buffer: bytearray) -> bytearray:
    buffer.extend(bytes(-(len(buffer) - len(_ENCAPSULATION)) % 4))
    return buffer


def _string(buffer: bytearray, text: str) -> None:
    encoded = text.encode() + b"\0"
    _aligned(buffer).extend(struct.pack("<I", len(encoded)) + encoded)


def _header(stamp_ns: int, frame_id: str) -> bytearray:
    buffer = bytearray(_ENCAPSULATION)
    buffer.extend(struct.pack("<iI", *divmod(stamp_ns, 1_000_000_000)))
    _string(buffer, frame_id)
    return buffer


def point_bytes(sweep: Sweep) -> memoryview:
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
    return points.view(np.uint8).data


def encode_points(sweep: Sweep, frame_id: str) -> tuple[bytes, memoryview, bytes]:
    """A sweep as ``sensor_msgs/msg/PointCloud2`` in three parts: what stands before its points, these laid out as
    :data:`POINT_DTYPE`, and what follows.

    Raises:
        OverflowError: a point lies more than 2.1 s from its sweep's stamp.
    """
    n = len(sweep.xyz)
    points = point_bytes(sweep)
    buffer = _header(sweep.stamp_ns, frame_id)
    _aligned(buffer).extend(struct.pack("<III", 1, n, len(_FIELDS)))
    for name, offset, datatype in _FIELDS:
        _string(buffer, name)
        _aligned(buffer).extend(struct.pack("<IB3xI", offset, datatype, 1))
    size = n * POINT_DTYPE.itemsize
    buffer.extend(struct.pack("<B3xIII", 0, POINT_DTYPE.itemsize, size, size))
    return bytes(buffer), points, b"\x01"  # is_dense: points without a return were dropped


@dataclass(frozen=True, slots=True)
class PointLayout:
    """Where the varying parts of every message of one file stand; they share frame_id and fields."""

    frame_id: str
    width_at: int
    data_at: int

    @classmethod
    def of(cls, message: bytes | memoryview) -> PointLayout:
        """Read the layout off one message.

        Raises:
            ReadError: ``not_normalised``, the message does not have the layout of :func:`encode_points`.
        """
        (length,) = struct.unpack_from("<I", message, 12)
        frame_id = bytes(message[16 : 16 + length - 1]).decode()
        none = np.zeros(0, np.float32)
        empty = Sweep(0, none.reshape(0, 3), none, none.astype(np.uint16), none.astype(np.int64))
        template = b"".join(encode_points(empty, frame_id))
        width_at = len(_aligned(_header(0, frame_id))) + 4
        data_at = len(template) - 1
        # Between width and the sizes at the end stand the fields; they must be ours byte for byte.
        if bytes(message[width_at + 4 : data_at - 8]) != template[width_at + 4 : data_at - 8]:
            raise ReadError(
                "not_normalised",
                "The point clouds in this file do not have the layout that apexcal writes.",
                "Give the original recording to the ingestion instead of a file that another program wrote.",
            )
        return cls(frame_id, width_at, data_at)

    def decode(self, message: bytes | memoryview, time_source: TimeSource) -> Sweep:
        """One message as a :class:`Sweep`; every array is a fresh, contiguous copy."""
        sec, nanosec = struct.unpack_from("<iI", message, 4)
        (n,) = struct.unpack_from("<I", message, self.width_at)
        raw = np.frombuffer(message, np.uint8, n * POINT_DTYPE.itemsize, self.data_at)
        points = raw.view(POINT_DTYPE)
        # Copied as one item of 12 bytes a point, faster than as numbers.
        together = np.ndarray((n,), "V12", message, self.data_at, (POINT_DTYPE.itemsize,))
        xyz: NDArray[np.float32] = together.copy().view("<f4").reshape(n, 3)
        return Sweep(
            stamp_ns=sec * 1_000_000_000 + nanosec,
            xyz=xyz,
            intensity=points["intensity"].copy(),
            ring=points["ring"].copy(),
            offset_ns=points["offset_ns"].astype(np.int64),
            time_source=time_source,
        )


def encode_image(stamp_ns: int, frame_id: str, media_type: str, size: int) -> bytes:
    """What stands before the ``size`` bytes of an encoded image in ``sensor_msgs/msg/CompressedImage``; these follow
    byte for byte and end the message.
    """
    buffer = _header(stamp_ns, frame_id)
    _string(buffer, media_type.removeprefix("image/"))
    _aligned(buffer).extend(struct.pack("<I", size))
    return bytes(buffer)
