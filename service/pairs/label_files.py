"""Reads ``labels.txt`` of the MATLAB toolbox that the paper's authors released.

A line holds seven numbers: the LiDAR frame, the camera frame, x y z (metres, LiDAR frame) and u v (pixels). MATLAB
counts pixels from 1, so 1 is subtracted from u and v.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator

from service.pairs.pair_files import MAX_PAIRS, Columns, invalid
from service.platform.http.problems import Problem

_NAMES = ("LiDAR frame", "camera frame", "x", "y", "z", "u", "v")
# Metres. The authors walk within 30 m, and no sensor that is read here sees farther.
_FARTHEST_M = 500.0
# The centre of MATLAB's first pixel lies at 1, its edge at 0.5.
_FIRST_EDGE = 0.5
# A line of seven numbers is far shorter.
_HEAD = 2000

FROM_ONE = (
    "The file was read as the toolbox's labels.txt. Its pixels count from 1, so 1 was subtracted from u and v; a "
    "LiDAR frame is one group."
)


def is_labels(text: str) -> bool:
    """Whether the first line that holds anything holds seven numbers and no comma."""
    first = next((line for line in io.StringIO(text[:_HEAD]) if line.strip()), "")
    words = first.split()
    return "," not in first and len(words) == len(_NAMES) and all(_is_number(word) for word in words)


def read_labels(text: str) -> Columns:
    """Columns x y z u v and group.

    Raises:
        Problem: 422 ``invalid_pairs``, naming the line.
    """
    columns: Columns = {name: [] for name in ("x", "y", "z", "u", "v", "group")}
    for number, row in _rows(text):
        frame, image, *point, u, v = row
        if any(number < 1 or number != int(number) for number in (frame, image)):
            raise _refused(number, "the first two numbers must be frame numbers from 1")
        if math.hypot(*point) > _FARTHEST_M:
            raise _refused(number, f"the corner lies {math.hypot(*point):.0f} m away: x, y and z are metres")
        if u < _FIRST_EDGE or v < _FIRST_EDGE:
            raise _refused(number, f"the mark ({u:g}, {v:g}) lies outside of the image, whose first pixel is (1, 1)")
        for name, value in zip(("x", "y", "z"), point, strict=True):
            columns[name].append(value)
        columns["u"].append(u - 1.0)
        columns["v"].append(v - 1.0)
        columns["group"].append(int(frame))
        if len(columns["x"]) > MAX_PAIRS:
            raise invalid(f"There are more than {MAX_PAIRS} pairs.")
    return columns


def _rows(text: str) -> Iterator[tuple[int, list[float]]]:
    # Read from bytes: a StringIO of the text would take four bytes for each letter.
    lines = io.TextIOWrapper(io.BytesIO(text.encode()), "utf-8")
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words:
            continue
        if len(words) != len(_NAMES):
            raise _refused(number, f"it has {len(words)} numbers, not {len(_NAMES)} ({', '.join(_NAMES)})")
        strange = next((word for word in words if not _is_number(word)), None)
        if strange is not None:
            raise _refused(number, f"{strange[:40]!r} is no number")
        yield number, [float(word) for word in words]


def _is_number(word: str) -> bool:
    if "_" in word or not word.isascii():
        return False
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _refused(line: int, why: str) -> Problem:
    return invalid(f"line {line}: {why}.", line=line)
