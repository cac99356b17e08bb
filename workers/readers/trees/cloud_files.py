"""Columns of a file that holds one point cloud: PCD, PLY, KITTI's .bin, .npy, .csv."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.clouds.fields import is_point_table
from workers.readers.clouds.pointcloud2 import MAX_POINTS, empty_cloud
from workers.readers.recording import MessageError
from workers.readers.trees.plain_columns import are_coordinates, name_columns, width_of
from workers.readers.trees.ply import read_ply, truncated_cloud

CLOUD_SUFFIXES: Final = frozenset({".pcd", ".ply", ".bin", ".npy"})
UNNAMED: Final = frozenset({".bin", ".npy", ".csv"})
"""Formats that need not name their columns."""
_MOST_PLAIN: Final = 8
_TELLING: Final = 672_000  # bytes that tell the columns; whole rows of every width from 3 to 8
_HEAD: Final = 65_536
_NUMBER: Final = re.compile(r"[+-]?(?:(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?|nan|inf(?:inity)?)", re.IGNORECASE)
_NPY_HINT: Final = (
    "Save a structured array with fields x, y, z, intensity, ring, or a plain one of shape (N, 4) to (N, 8) with x, "
    "y, z, intensity, ring, time in this order."
)
_CSV_HINT: Final = "Write a header line such as x,y,z,intensity,ring, then one line of numbers per point."
# Columns of a table of corners or pairs (docs/imports.md), whose points are no sweep.
_OF_PAIRS: Final = frozenset(("u", "v", "pose", "group", "corner", "vertex"))
_MAX_FIELDS: Final = 256
_MAX_HEADER: Final = 65_536
Arrays = Mapping[str, NDArray[np.generic]]


def read_cloud(data: bytes, path: str, names: Sequence[str] | None = None) -> Arrays:
    """One (N,) array per field of a cloud in a file.

    Args:
        data: the whole file.
        path: of the file; its suffix tells the format, and it names the file in errors.
        names: of the columns, where the file does not name them; None: its own content tells.

    Raises:
        MessageError: ``cloud_empty``, ``cloud_malformed``, ``cloud_truncated``.
    """
    suffix = PurePosixPath(path).suffix.lower()
    if not data:
        raise empty_cloud(path)
    if suffix == ".pcd":
        from workers.readers.trees.pcd import read_pcd  # its library takes 0.13 s to import

        return read_pcd(data, path)
    if suffix == ".ply":
        return read_ply(data, path)
    if suffix == ".bin":
        return _read_bin(data, path, names)
    return _read_npy(data, path, names) if suffix == ".npy" else _read_csv(data, path, names)


def column_names(files: Mapping[str, bytes]) -> list[str] | None:
    """Return the names of the columns that files of one sensor do not name, by what all of them hold.

    Args:
        files: content by path, of one format.

    Returns:
        None where each file names its own, or where what they hold does not tell.
    """
    path, data = next(iter(files.items()))
    suffix = PurePosixPath(path).suffix.lower()
    if suffix == ".bin":
        whole = [data for data in files.values() if len(data) % 4 == 0]
        values = np.frombuffer(b"".join(data[:_TELLING] for data in whole), "<f4")
        width = width_of(values, [len(data) // 4 for data in whole])
        return None if width is None else name_columns(values[: len(values) // width * width].reshape(-1, width))
    if suffix == ".npy":
        array = _npy_array(data, path)
        return name_columns(array) if _is_plain(array) else None
    return name_columns(_csv_table(data, path), is_free=True) if is_bare_table(data[:_HEAD]) else None


def is_cloud_table(head: bytes) -> bool:
    """Whether a CSV file that begins with these bytes has columns x, y and z, and none of a table of corners."""
    names = _names(_first_line(head))
    return is_point_table(names) and not _OF_PAIRS & {name.lower() for name in names}


def _malformed(path: str, why: str, hint: str) -> MessageError:
    return MessageError("cloud_malformed", f"{path} is no point cloud: {why}.", hint)


def _read_bin(data: bytes, path: str, names: Sequence[str] | None) -> Arrays:
    """float32 rows without a header: KITTI's x y z intensity, nuScenes' with a ring, or others with a time, too."""
    hint = (
        "A .bin file holds x, y, z and intensity as little-endian float32, as KITTI's do, and after them a ring or a "
        "time; write others as .npy."
    )
    names = names or (column_names({path: data}) if len(data) % 4 == 0 else None)
    if names is None or len(data) % (4 * len(names)):
        point = f"of {4 * len(names)} bytes" if names else "of 3 to 8 values of 4 bytes"
        raise _malformed(path, f"{len(data)} bytes are no whole number of points {point}", hint)
    points = np.frombuffer(data, "<f4").reshape(-1, len(names))
    if not are_coordinates(points[:, :3]):
        doubles = np.frombuffer(data[: len(data) // 8 * 8], "<f8")
        why = "its values are float64" if are_coordinates(doubles[:, None]) else "many coordinates lie beyond 2000 m"
        raise _malformed(path, f"read as {len(names)} float32 values a point, {why}", hint)
    return {name: points[:, i] for i, name in enumerate(names)}


def _npy_array(data: bytes, path: str) -> NDArray[Any]:
    try:
        return np.lib.format.read_array(io.BytesIO(data), max_header_size=_MAX_HEADER)
    except (ValueError, SyntaxError, TypeError, KeyError, RecursionError, MemoryError, EOFError) as error:
        if "array data" in str(error):
            raise truncated_cloud(path, str(error).splitlines()[0].rstrip(".")) from error
        raise _malformed(path, "its .npy header cannot be read", _NPY_HINT) from error


def _is_plain(array: NDArray[Any]) -> bool:
    return array.ndim == 2 and 3 <= array.shape[1] <= _MOST_PLAIN and array.dtype.kind in "iuf"


def _read_npy(data: bytes, path: str, names: Sequence[str] | None) -> Arrays:
    """A structured array, or a plain one of 3 to 8 columns: x y z, intensity, then a ring and a time."""
    array = _npy_array(data, path)
    if array.dtype.names:
        whole = {name: array[name] for name in array.dtype.names}
        columns: Arrays = {
            name: values.reshape(array.size, *values.shape[array.ndim :]) for name, values in whole.items()
        }
        return {name: values for name, values in columns.items() if values.dtype.kind in "iufb"}
    if not _is_plain(array):
        raise _malformed(path, f"its shape is {array.shape} of {array.dtype}", _NPY_HINT)
    if names is None or len(names) != array.shape[1]:
        names = name_columns(array) or ()
    return {name: array[:, i] for i, name in enumerate(names)}


def _first_line(head: bytes) -> str:
    return head.split(b"\n", 1)[0].decode("utf-8-sig", "replace").strip("\r ")


def _names(line: str) -> list[str]:
    return [name.strip().strip('"').strip() for name in line.lstrip("#/ ").split(_delimiter(line))]


def _delimiter(line: str) -> str:
    return max(",;\t", key=line.count)


def is_bare_table(head: bytes) -> bool:
    """Whether a CSV file that begins with these bytes has no header, but 3 to 8 numbers in each line."""
    lines = [line.split(_delimiter(line)) for line in head.decode("utf-8-sig", "replace").splitlines()[:5]]
    whole = lines[:-1] if len(lines) > 1 else lines  # the head may end within a line
    widths = {len(line) for line in whole}
    is_wide = len(widths) == 1 and 3 <= widths.pop() <= _MOST_PLAIN
    return is_wide and all(_NUMBER.fullmatch(cell.strip()) for line in whole for cell in line)


def _read_csv(data: bytes, path: str, names: Sequence[str] | None) -> Arrays:
    """A header line with the columns' names, then numbers; or numbers alone."""
    if is_bare_table(data[:_HEAD]):
        table = _csv_table(data, path)
        names = names if names and len(names) == table.shape[1] else name_columns(table, is_free=True)
        if names is None:
            first = _first_line(data[:_HEAD])[:80]
            why = f"it has no header line, and its {table.shape[1]} columns may be one thing or another ({first})"
            raise _malformed(path, why, "Add a first line that names them, such as x,y,z,intensity,ring,time.")
        return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}
    names = _names(_first_line(data[:_HEAD]))
    if len(names) != len(set(names)) or len(names) > _MAX_FIELDS:
        raise _malformed(path, "its header names a column twice, or hundreds of them", _CSV_HINT)
    table = _csv_table(data, path, header=1, width=len(names))
    if table.shape[1] != len(names):
        raise _malformed(path, f"its lines have {table.shape[1]} values for {len(names)} names", _CSV_HINT)
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}


def _csv_table(data: bytes, path: str, header: int = 0, width: int = 0) -> NDArray[np.float64]:
    """The numbers (N, M) of a table; (0, ``width``) of a header alone."""
    if data.count(b"\n") > MAX_POINTS:
        raise _malformed(path, f"it has more than {MAX_POINTS} lines", _CSV_HINT)
    delimiter = _delimiter(_first_line(data[:_HEAD]))
    try:
        text = data.decode("utf-8-sig")
        body = (text[text.index("\n") + 1 :] if "\n" in text else "") if header else text
        if not body.strip():
            return np.zeros((0, width))
        return np.loadtxt(io.StringIO(body), delimiter=delimiter, ndmin=2, comments=None, quotechar='"')
    except (ValueError, csv.Error) as error:
        raise _malformed(path, str(error).splitlines()[0][:200].rstrip("."), _CSV_HINT) from error
