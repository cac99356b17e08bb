"""Reads imported 3D-2D pairs (CSV or JSON) into columns, or refuses them by line and column."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from pydantic_core import from_json

from apexcal.documents.corners import CORNERS
from apexcal.documents.pairs import CORNER, MARK_SIGMA, REQUIRED, SIGMAS
from service.platform.db.fleets import RigCamera
from service.platform.http.problems import Problem, unprocessable

_LEAST_MARK_SIGMA_PX = 0.01
_OPTIONAL = ("stamp_ns", "group", *SIGMAS, MARK_SIGMA, CORNER)
Columns = dict[str, list[Any]]

MAX_PAIRS = 100_000
# As many pairs in JSON, with 320 letters each: every member that a pair may have, in all its digits.
MAX_BYTES = 32 * 1024 * 1024
# A set made of marks, which may be imported again, has up to 24 members a pair; a document holds its notes besides.
_MAX_MEMBERS, _MAX_NOTES = 24, 1000
_INT64 = 2**63
_INTEGER = re.compile(r"[+-]?[0-9]{1,18}")
_HINT = (
    "A CSV file has a header with x,y,z (metres, LiDAR frame), u,v (pixels; (0, 0) is the centre of the top-left "
    "one) and perhaps stamp_ns (integer nanoseconds), group, the corner's standard deviations sigma_azimuth_rad, "
    "sigma_elevation_rad, sigma_range_m, the mark's sigma_px, and the board's corner (top, left, right, bottom). "
    "JSON has the same names in each of its pairs."
)


def invalid(detail: str, **fields: Any) -> Problem:
    """The refusal of pairs that cannot be used."""
    return unprocessable("invalid_pairs", detail, _HINT, **fields)


def read_csv(text: str) -> Columns:
    """Columns x y z u v, and those of ``stamp_ns``, ``group`` and the sigmas that the header has.

    ``pose`` is taken for ``group``.

    Raises:
        Problem: 422 ``invalid_pairs``, naming line and column.
    """
    # Read from bytes: a StringIO of the text would take four bytes for each letter.
    lines = io.TextIOWrapper(io.BytesIO(text.removeprefix("\ufeff").encode()), "utf-8", newline="")
    reader = csv.reader(lines, strict=True)
    try:
        header = [name.strip().lower() for name in next(reader, [])]
        places = _places(header)
        rows = (
            (f"line {reader.line_num}", _pick(row, places, header, reader.line_num)) for row in reader if any(row)
        )
        return _columns(rows, "column")
    except csv.Error as error:
        raise invalid(f"line {reader.line_num}: {error}.") from None


def read_json(body: bytes) -> Columns:
    """Read the columns of ``{"pairs": [{"x", "y", "z", "u", "v", "stamp_ns"?, "group"?, ...}]}``.

    Raises:
        Problem: 422 ``invalid_pairs``, naming the pair and its member.
    """
    # 32 MiB of `[{},...` would become gigabytes of objects. Signs within texts count too: names hold few.
    if body.count(b"{") + body.count(b"[") > MAX_PAIRS + _MAX_NOTES or body.count(b",") > _MAX_MEMBERS * MAX_PAIRS:
        raise invalid(f"There are more than {MAX_PAIRS} pairs, or more than {_MAX_MEMBERS} members in each.")
    try:
        document = from_json(body.removeprefix(b"\xef\xbb\xbf"))
    except ValueError as error:
        raise invalid(f"The body is no JSON that holds pairs: {error}.") from None
    pairs = document.get("pairs") if isinstance(document, dict) else None
    if not isinstance(pairs, list):
        raise invalid('The body is no JSON that holds pairs: it has no list "pairs".')
    return _columns(_rows(pairs), "member")


def _rows(pairs: Iterable[Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    columns = {*REQUIRED, *_OPTIONAL, "pose"}
    for number, pair in enumerate(pairs):
        if not isinstance(pair, dict):
            raise invalid(f"pairs[{number}] is no object.")
        row = {name: value for name, value in pair.items() if name in columns and value is not None}
        if "pose" in row:
            row.setdefault("group", row.pop("pose"))
        yield f"pairs[{number}]", row


def _places(header: list[str]) -> dict[str, int]:
    """Return the column of each name in the header."""
    places = {name: header.index(name) for name in (*REQUIRED, *_OPTIONAL) if name in header}
    if "group" not in places and "pose" in header:
        places["group"] = header.index("pose")
    missing = [name for name in REQUIRED if name not in places]
    if missing:
        separator = next((sign for sign in (";", "\t") if len(header) == 1 and sign in header[0]), None)
        if separator:
            raise invalid(
                f"line 1: the header lacks {', '.join(missing)}, for the columns are separated by "
                f"{'semicolons' if separator == ';' else 'tabs'}. Separate them by commas "
                "and write decimals with a point."
            )
        raise invalid(f"line 1: the header lacks {', '.join(missing)}; it has {', '.join(header) or 'nothing'}.")
    twice = [name for name in places if header.count(name) > 1]
    if twice:
        raise invalid(f"line 1: the header names {twice[0]} twice.")
    return places


def _pick(row: list[str], places: Mapping[str, int], header: list[str], line: int) -> dict[str, str]:
    if len(row) != len(header):
        raise invalid(f"line {line} has {len(row)} columns, the header {len(header)}.", line=line)
    return {name: row[index].strip() for name, index in places.items()}


def _columns(rows: Iterable[tuple[str, Mapping[str, Any]]], kind: str) -> Columns:
    columns: Columns = {}
    count = 0
    for where, row in rows:
        if count == 0:
            columns = {name: [] for name in (*REQUIRED, *_OPTIONAL) if name in row or name in REQUIRED}
        if count >= MAX_PAIRS:
            raise invalid(f"There are more than {MAX_PAIRS} pairs.")
        for name in {*columns, *row}:
            if name not in columns:
                raise invalid(f"{where}, {kind} {name}: the pairs before it have none; give it for all, or for none.")
            if name not in row or row[name] == "":
                raise invalid(f"{where}, {kind} {name}: is missing.")
            try:
                columns[name].append(_READ.get(name, _number)(row[name]))
            except ValueError as error:
                raise invalid(f"{where}, {kind} {name}: {_shown(row[name])} {error}.") from None
        count += 1
    if count == 0:
        raise invalid("There are no pairs.")
    return _plain_groups(columns)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError("is no number")
    if isinstance(value, str) and ("_" in value or not value.isascii()):
        raise ValueError("is no number; numbers are written in the digits 0 to 9")
    try:
        number = float(value)
    except (ValueError, OverflowError):
        raise ValueError("is no number") from None
    if not math.isfinite(number):
        raise ValueError("is not finite")
    if abs(number) > 1e9:
        raise ValueError("is too large for metres or pixels")
    return number


def _stamp(value: Any) -> int:
    if isinstance(value, str) and re.fullmatch(r"[+-]?[0-9]{1,19}", value):
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError("is no integer; stamp_ns counts nanoseconds")
    if not -_INT64 <= value < _INT64:
        raise ValueError("does not fit into 64 bits")
    return value


def _group(value: Any) -> str:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise ValueError("is neither a name nor an integer")
    text = str(value)
    if len(text) > 100 or not text.isprintable():
        raise ValueError("is no name of at most 100 letters")
    return text


def _sigma(value: Any) -> float:
    number = _number(value)
    if number <= 0.0:
        raise ValueError("is not above 0; leave the column out where it is not known")
    return number


def _mark_sigma(value: Any) -> float:
    number = _sigma(value)
    if number < _LEAST_MARK_SIGMA_PX:
        raise ValueError(f"is below {_LEAST_MARK_SIGMA_PX:g} px: it would outweigh all others")
    return number


def _corner(value: Any) -> str:
    if value not in CORNERS:
        raise ValueError(f"is no corner of the board; it has {', '.join(CORNERS)}")
    return str(value)


_READ: dict[str, Callable[[Any], Any]] = (
    {"stamp_ns": _stamp, "group": _group, CORNER: _corner} | dict.fromkeys(SIGMAS, _sigma) | {MARK_SIGMA: _mark_sigma}
)


def _plain_groups(columns: Columns) -> Columns:
    """Groups that all are integers become integers, so that pose 10 comes after pose 9."""
    groups = columns.get("group")
    if groups and all(_INTEGER.fullmatch(group) for group in groups):
        columns["group"] = [int(group) for group in groups]
    return columns


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def notes_on_image(columns: Columns, camera: RigCamera) -> list[str]:
    """A sentence where marks lie outside the image that the rig says the camera has."""
    outside = sum(
        not (-0.5 <= u <= camera.image_width - 0.5 and -0.5 <= v <= camera.image_height - 0.5)
        for u, v in zip(columns["u"], columns["v"], strict=True)
    )
    if not outside:
        return []
    which = "1 pair lies" if outside == 1 else f"{outside} pairs lie"
    return [
        f"{which} outside the image of {camera.image_width} x {camera.image_height} pixels that the rig gives "
        f"for {camera.name}: is the image size right, are u and v in this order?"
    ]
