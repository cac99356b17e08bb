"""Columns of a file that holds one point cloud: PCD, PLY, KITTI's .bin, .npy, .csv."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import PurePosixPath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.clouds.fields import is_point_table
from workers.readers.clouds.pointcloud2 import MAX_POINTS
from workers.readers.recording import MessageError
from workers.readers.trees.ply import read_ply, truncated_cloud

CLOUD_SUFFIXES: Final = frozenset({".pcd", ".ply", ".bin", ".npy"})
_PLAIN: Final = ("x", "y", "z", "intensity", "ring", "time")
# Columns of a table of corners or pairs (docs/imports.md), whose points are no sweep.
_OF_PAIRS: Final = frozenset(("u", "v", "pose", "group", "corner", "vertex"))
_FARTHEST_M: Final = 2000.0
_MAX_FIELDS: Final = 256
_MAX_HEADER: Final = 65_536
Arrays = Mapping[str, NDArray[np.generic]]


def read_cloud(data: bytes, path: str) -> Arrays:
    """One (N,) array per field of a cloud in a file.

    Args:
        data: the whole file.
        path: of the file; its suffix tells the format, and it names the file in errors.

    Raises:
        MessageError: ``cloud_malformed``, ``cloud_truncated``.
    """
    suffix = PurePosixPath(path).suffix.lower()
    if suffix == ".pcd":
        from workers.readers.trees.pcd import read_pcd  # its library takes 0.13 s to import

        return read_pcd(data, path)
    if suffix == ".ply":
        return read_ply(data, path)
    if suffix == ".bin":
        return _read_bin(data, path)
    return _read_npy(data, path) if suffix == ".npy" else _read_csv(data, path)


def is_cloud_table(head: bytes) -> bool:
    """Whether a CSV file that begins with these bytes has columns x, y and z, and none of a table of corners."""
    names = _names(_first_line(head))
    return is_point_table(names) and not _OF_PAIRS & {name.lower() for name in names}


def _malformed(path: str, why: str, hint: str) -> MessageError:
    return MessageError("cloud_malformed", f"{path} is no point cloud: {why}.", hint)


def _read_bin(data: bytes, path: str) -> Arrays:
    """float32 rows without a header: KITTI's x y z intensity, or nuScenes' (.pcd.bin) with a ring."""
    width = 5 if path.lower().endswith(".pcd.bin") else 4
    hint = "A .bin file holds x, y, z and intensity as little-endian float32, as KITTI's do; write others as .npy."
    if len(data) % (4 * width):
        raise _malformed(path, f"{len(data)} bytes are no whole number of points of {4 * width} bytes", hint)
    points = np.frombuffer(data, "<f4").reshape(-1, width)
    with np.errstate(invalid="ignore"):
        sane = (np.abs(points[:, :3]) < _FARTHEST_M) | np.isnan(points[:, :3])
    if len(points) and np.mean(sane) < 0.99:
        raise _malformed(path, f"as {width} float32 a point, many coordinates lie past {_FARTHEST_M:.0f} m", hint)
    return {name: points[:, i] for i, name in enumerate(_PLAIN[:width])}


def _read_npy(data: bytes, path: str) -> Arrays:
    """A structured array, or a plain one of 3 to 6 columns: x y z [intensity [ring [time]]]."""
    hint = (
        "Save a structured array with fields x, y, z, intensity, ring, or a plain one of shape (N, 4) to (N, 6) with "
        "x, y, z, intensity, ring, time in this order."
    )
    try:
        array: NDArray[Any] = np.lib.format.read_array(io.BytesIO(data), max_header_size=_MAX_HEADER)
    except (ValueError, SyntaxError, TypeError, KeyError, RecursionError, MemoryError, EOFError) as error:
        if "array data" in str(error):
            raise truncated_cloud(path, str(error).splitlines()[0].rstrip(".")) from error
        raise _malformed(path, "its .npy header cannot be read", hint) from error
    if array.dtype.names:
        whole = {name: array[name] for name in array.dtype.names}
        columns: Arrays = {
            name: values.reshape(array.size, *values.shape[array.ndim :]) for name, values in whole.items()
        }
        return {name: values for name, values in columns.items() if values.dtype.kind in "iufb"}
    if array.ndim != 2 or not 3 <= array.shape[1] <= len(_PLAIN) or array.dtype.kind not in "iuf":
        raise _malformed(path, f"its shape is {array.shape} of {array.dtype}", hint)
    if array.shape[1] > 4:
        _check_whole(array[:, 4], path, hint)
    return {name: array[:, i] for i, name in enumerate(_PLAIN[: array.shape[1]])}


def _check_whole(ring: NDArray[np.generic], path: str, hint: str) -> None:
    numbers = ring.astype(np.float64)
    numbers = numbers[np.isfinite(numbers)]
    if np.any(numbers != np.rint(numbers)) or np.any(numbers < 0):
        raise _malformed(path, "its fifth column should be the ring, and holds no whole numbers", hint)


def _first_line(head: bytes) -> str:
    return head.split(b"\n", 1)[0].decode("utf-8-sig", "replace").strip("\r ")


def _names(line: str) -> list[str]:
    return [name.strip().strip('"').strip() for name in line.lstrip("#/ ").split(_delimiter(line))]


def _delimiter(line: str) -> str:
    return max(",;\t", key=line.count)


def _read_csv(data: bytes, path: str) -> Arrays:
    """A header line with the columns' names, then numbers."""
    hint = "Write a header line such as x,y,z,intensity,ring, then one line of numbers per point."
    line = _first_line(data[:65536])
    names = _names(line)
    if len(names) != len(set(names)) or len(names) > _MAX_FIELDS:
        raise _malformed(path, "its header names a column twice, or hundreds of them", hint)
    if data.count(b"\n") > MAX_POINTS:
        raise _malformed(path, f"it has more than {MAX_POINTS} lines", hint)
    try:
        text = data.decode("utf-8-sig")
        body = text[text.index("\n") + 1 :] if "\n" in text else ""
        if not body.strip():
            table = np.zeros((0, len(names)))
        else:
            table = np.loadtxt(io.StringIO(body), delimiter=_delimiter(line), ndmin=2, comments=None, quotechar='"')
    except (ValueError, csv.Error) as error:
        raise _malformed(path, str(error).splitlines()[0][:200].rstrip("."), hint) from error
    if table.shape[1] != len(names):
        raise _malformed(path, f"its lines have {table.shape[1]} values for {len(names)} names", hint)
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}
