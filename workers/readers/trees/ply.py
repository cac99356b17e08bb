"""Columns of a PLY file's vertices (ascii, binary of either byte order), after the format's description of 1994."""

from __future__ import annotations

import io
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.clouds.fields import is_point_table, listed
from workers.readers.clouds.pointcloud2 import MAX_POINTS
from workers.readers.recording import MessageError

_HEADER_BYTES: Final = 16_384
_MOST_FIELDS: Final = 256
_TYPES: Final = {
    name: kind
    for names, kind in (
        *(("char int8", "i1"), ("uchar uint8", "u1"), ("short int16", "i2"), ("ushort uint16", "u2")),
        *(("int int32", "i4"), ("uint uint32", "u4"), ("float float32", "f4"), ("double float64", "f8")),
    )
    for name in names.split()
}
_ORDERS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read_ply(data: bytes, where: str) -> dict[str, NDArray[np.generic]]:
    """One (N,) array per property of the vertices, which must be the file's first element.

    Args:
        data: the whole file.
        where: names the file in errors.

    Raises:
        MessageError: ``cloud_malformed``, ``cloud_truncated``.
    """
    order, count, fields, start = _header(data, where)
    if order == "":
        return _read_ascii(data[start:], count, fields, where)
    layout = np.dtype([(name, order + kind) for name, kind in fields])
    whole = count * layout.itemsize
    if len(data) - start < whole:
        raise truncated_cloud(where, f"{len(data) - start} of {whole} bytes of points are there")
    points = np.frombuffer(data, layout, count, start)
    return {name: points[name] for name, _ in fields}


def _header(data: bytes, where: str) -> tuple[str, int, list[tuple[str, str]], int]:
    """Byte order (empty: ascii), number of vertices, their properties, and where they begin."""
    head = data[:_HEADER_BYTES]
    end = head.find(b"end_header")
    start = head.find(b"\n", end) + 1
    if not head.startswith(b"ply") or end < 0 or start == 0:
        raise _malformed(where, "it has no header from ply to end_header")
    order, count, fields = None, None, list[tuple[str, str]]()
    element = ""
    for line in head[:end].decode("ascii", "replace").splitlines()[1:]:
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            order = _ORDERS.get(words[1])
        elif words[:1] == ["element"] and len(words) == 3:
            if element == "" and words[1] != "vertex":
                raise _malformed(where, f"its first element is {words[1][:40]!r} and not vertex")
            element = words[1]
            count = int(words[2]) if element == "vertex" and words[2].isdigit() and len(words[2]) < 12 else count
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in _TYPES:
                raise _malformed(where, f"its vertices have a property that is no number ({line.strip()[:60]!r})")
            fields.append((words[2], _TYPES[words[1]]))
    names = [name for name, _ in fields]
    if order is None or count is None or count > MAX_POINTS or not is_point_table(names):
        why = "its header states no format, no number of vertices or no x, y and z of theirs"
        raise _malformed(where, f"{why} (properties: {listed(names) or 'none'})")
    if len(set(names)) < len(names) or len(names) > _MOST_FIELDS:
        raise _malformed(where, "its header names a property twice, or hundreds of them")
    return order, count, fields, start


def _read_ascii(body: bytes, count: int, fields: list[tuple[str, str]], where: str) -> dict[str, NDArray[np.generic]]:
    if count == 0:
        return {name: np.zeros(0, kind) for name, kind in fields}
    try:
        table = np.loadtxt(io.StringIO(body.decode("ascii")), ndmin=2, max_rows=count, comments=None)
    except ValueError as error:
        raise _malformed(where, str(error).splitlines()[0][:200].rstrip(".")) from error
    if table.shape[1] != len(fields):
        raise _malformed(where, f"its lines have {table.shape[1]} values for {len(fields)} properties")
    if len(table) < count:
        raise truncated_cloud(where, f"{len(table)} of {count} points are there")
    return {name: table[:, number] for number, (name, _) in enumerate(fields)}


def _malformed(where: str, why: str) -> MessageError:
    return MessageError(
        "cloud_malformed",
        f"{where} is no PLY file of points: {why}.",
        "Export it again as PLY with vertices of x, y, z and, best, intensity and ring; or as PCD.",
    )


def truncated_cloud(where: str, why: str) -> MessageError:
    """The refusal of a cloud's file that ends too early."""
    return MessageError("cloud_truncated", f"{where} is cut short: {why}.", "Copy the file again, or leave it out.")
