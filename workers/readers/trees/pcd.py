"""Columns of a PCD file (ascii, binary, binary_compressed), through the pypcd4 library."""

from __future__ import annotations

import io
import re
import struct
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray
from pypcd4.pypcd4 import PointCloud

from workers.readers.clouds.pointcloud2 import MAX_POINTS
from workers.readers.recording import MessageError
from workers.readers.trees.ply import truncated_cloud

_HEADER_BYTES: Final = 4096
# The longest copy of LZF takes 3 bytes and gives 264.
LZF_LIMIT: Final = 88
_NUMBER: Final = re.compile(rb"^(SIZE|COUNT|POINTS)\s+([\d ]+)$", re.MULTILINE)


def _damaged(where: str, why: str) -> MessageError:
    return MessageError(
        "cloud_malformed",
        f"{where} is no valid PCD file: {why}.",
        "Export it again; a PCD file starts with a header of text lines from VERSION to DATA.",
    )


def read_pcd(data: bytes, where: str) -> dict[str, NDArray[np.generic]]:
    """One (N,) array per field.

    Args:
        data: the whole file.
        where: names the file in errors.

    Raises:
        MessageError: ``cloud_malformed``, ``cloud_truncated``.
    """
    encoding = _check_claims(data, where)
    if encoding == b"ascii":
        data = re.sub(rb"[ \t]+(\r?\n)", rb"\1", data)  # loadtxt takes a trailing blank for one more column
    try:
        # pypcd4 asks for a BufferedReader by name; it uses of it what BytesIO has.
        cloud = PointCloud.from_fileobj(cast(io.BufferedReader, io.BytesIO(data)))
    except (ValueError, RuntimeError, KeyError, struct.error, IndexError, TypeError, UnicodeDecodeError) as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise _damaged(where, why) from error
    points: NDArray[np.void] = np.atleast_1d(cast("NDArray[np.void]", cloud.pc_data))  # pyright: ignore[reportUnknownMemberType]
    if len(points) != cloud.metadata.points:
        raise truncated_cloud(where, f"{len(points)} of {cloud.metadata.points} points are there")
    return {name: points[name] for name in points.dtype.names or () if not name.startswith("#$%&~~")}


def _check_claims(data: bytes, where: str) -> bytes:
    """The encoding; what the header claims is held against the file's size before anything is allocated."""
    head = data[:_HEADER_BYTES]
    start = re.search(rb"^DATA\s+(\w+)\s*?\n", head, re.MULTILINE)
    if start is None:
        raise _damaged(where, "there is no DATA line in its first 4096 bytes")
    numbers = {
        m.group(1): [int(v) for v in m.group(2).split()]
        for m in _NUMBER.finditer(head[: start.end()].replace(b"\r", b""))
    }
    if b"SIZE" not in numbers or b"POINTS" not in numbers:
        raise _damaged(where, "its header has no SIZE or no POINTS line")
    sizes, (points,) = numbers[b"SIZE"], numbers[b"POINTS"][:1]
    counts = numbers.get(b"COUNT", [1] * len(sizes))
    bytes_needed = points * sum(s * c for s, c in zip(sizes, counts, strict=False))
    body = len(data) - start.end()
    if points > MAX_POINTS or sum(counts) > 256:
        raise _damaged(where, f"its header claims {points} points of {sum(counts)} values")
    encoding = start.group(1)
    if encoding == b"binary" and body < bytes_needed:
        raise truncated_cloud(where, f"{body} of {bytes_needed} bytes of points are there")
    if encoding == b"binary_compressed":
        if body < 8:
            raise truncated_cloud(where, "it ends with its header")
        packed, unpacked = struct.unpack_from("<II", data, start.end())
        if body - 8 < packed:
            raise truncated_cloud(where, f"{body - 8} of {packed} bytes of compressed points are there")
        if unpacked > LZF_LIMIT * packed:
            raise _damaged(where, f"{packed} bytes cannot hold the {unpacked} that they claim to unpack to")
        if unpacked != bytes_needed:
            raise _damaged(where, f"it unpacks to {unpacked} bytes where {points} points take {bytes_needed}")
    return encoding
