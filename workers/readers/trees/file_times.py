"""The stamps of a folder's files: from ``timestamps.csv``, KITTI's ``timestamps.txt``, times in names, or numbers."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import PurePosixPath
from typing import Final

import numpy as np

from workers.readers.recording import ReadError
from workers.readers.trees.name_times import UNITS_BY_DIGITS, is_time, learn_fraction, time_ns
from workers.readers.trees.series import KINDS, Series, TimesFrom, stem_and_number

CSV_NAME: Final = "timestamps.csv"
KITTI_NAME: Final = "timestamps.txt"
_NUMBER: Final = re.compile(r"\d+(?:\.\d+)?")
_INDEX_STEP_NS: Final = 100_000_000
# Not 0, which ROS reads as "no stamp".
_INDEX_START_NS: Final = 1_000_000_000
_MAX_NS: Final = 2**63 - 1
_KITTI_LINE: Final = re.compile(r"(\d{4}-\d\d-\d\d)[ T](\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?Z?")


def stamp_series(series: Sequence[Series], tables: Mapping[str, bytes], lines: Mapping[str, bytes]) -> None:
    """Give every file its stamp, and put the files in their order.

    Args:
        series: the files of each sensor.
        tables: content of every ``timestamps.csv`` by its path.
        lines: content of the ``timestamps.txt`` that belongs to a series, by the series' name.

    Raises:
        ReadError: ``timestamps_incomplete``, ``timestamps_malformed``, ``files_without_times``.
    """
    listed = listed_times(tables)
    every = [text for files in series for path, text in files.texts.items() if path not in listed]
    for files in series:
        files.times_from, stamps = _stamps(files, listed, lines.get(files.name), bool(tables), every)
        files.stamps_ns = dict(stamps)
        files.paths.sort(key=lambda path: (stamps[path], path))
    made_up = [files for files in series if files.times_from == "index"]
    if made_up and len(made_up) < len(series):
        raise without_times(f"Some files have a time, but {made_up[0].paths[0]} has only a number.")


def strays(series: Sequence[Series], listed: Collection[str]) -> list[str]:
    """Return the files that lie beside a sensor's sweeps or frames and are none of them: maps, corners, overviews.

    A file by itself is one if another sensor of its kind has several files, and if neither a table nor its name says
    its time. So is a file whose name ends in no number, in a folder where most names do.

    Args:
        series: the files of each sensor.
        listed: paths to which a table gives a time.
    """
    most = {kind: max((len(each.paths) for each in series if each.kind == kind), default=0) for kind in KINDS}
    paths: list[str] = []
    for files in series:
        texts = {path: text for path, text in files.texts.items() if path not in listed}
        bare = [path for path, text in texts.items() if not text]
        if len(files.paths) == 1 < most[files.kind]:
            paths += [path for path, text in texts.items() if not is_time(text)]
        elif 2 * len(bare) < len(files.paths):
            paths += bare
    return paths


def _stamps(
    files: Series,
    listed: Mapping[str, int],
    lines: bytes | None,
    has_tables: bool,
    every: Sequence[str],
) -> tuple[TimesFrom, Mapping[str, int]]:
    paths, texts = files.paths, files.texts
    missing = [path for path in paths if path not in listed]
    if not missing:
        return "csv", {path: listed[path] for path in paths}
    if len(missing) < len(paths):
        raise _incomplete(missing, len(paths))
    if lines is not None:
        return "kitti", kitti_stamps(kitti_times(lines, KITTI_NAME), paths)
    timed = [path for path, text in texts.items() if is_time(text)]
    if len(timed) == len(paths):
        return "names", _times(texts, every)
    if has_tables:
        raise _incomplete(missing, len(paths))
    nameless = [path for path, text in texts.items() if not text and len(paths) > 1]
    if nameless:
        raise without_times(f"The name of {nameless[0]} ends in no number ({len(nameless)} of {len(paths)} files).")
    if any(not texts[path].isdigit() for path in timed):
        odd = next(path for path in paths if path not in set(timed))
        raise without_times(f"Some files are named by their time, but {odd} is not.")
    absurd = next((path for path, text in texts.items() if len(text.lstrip("0")) > 9), None)
    if absurd is not None:
        raise without_times(
            f"The number in the name of {absurd} is no time since 1970 (10, 13, 16 or 19 digits) and too large to "
            "count files."
        )
    # A single file needs no number to be told from others.
    return "index", {path: _INDEX_START_NS + int(text or 0) * _INDEX_STEP_NS for path, text in texts.items()}


def without_times(why: str) -> ReadError:
    """The refusal of files whose moments nobody states."""
    return ReadError(
        "files_without_times",
        why,
        "Name all files by their time in nanoseconds (1600000000123456789.png), or all by a number (pose12.png), or "
        f"add {CSV_NAME} with the columns file,stamp_ns.",
    )


def _times(texts: Mapping[str, str], every: Sequence[str]) -> Mapping[str, int]:
    """Stamps by path, from the times in names; ``every``: those of all sensors."""
    read = learn_fraction(list(texts.values()), every)
    if read is None:
        odd = min(texts, key=lambda path: len(texts[path]))
        raise without_times(
            f"Fractions of a second in names have unequal lengths, as in {odd}: they may be decimals, or counts "
            "without leading zeros."
        )
    stamps = {path: time_ns(text, read) for path, text in texts.items()}
    late = next((path for path, stamp in stamps.items() if stamp > _MAX_NS), None)
    if late is not None:
        raise without_times(f"The name of {late} ends in no time: {texts[late]} lies past the year 2262.")
    return stamps


def _incomplete(missing: Sequence[str], count: int) -> ReadError:
    return ReadError(
        "timestamps_incomplete",
        f"{CSV_NAME} has no line for {missing[0]} ({len(missing)} of {count} files are missing).",
        f"List every file, its path relative to the folder of {CSV_NAME}.",
    )


def kitti_times(content: bytes, where: str) -> Sequence[int | None]:
    """Nanoseconds from lines like ``2011-09-26 13:02:25.964389445``, taken as UTC, or seconds or less since 1970.

    Returns:
        One for each line, None for an empty one, which stands for a frame that was lost.

    Raises:
        ReadError: ``timestamps_malformed``.
    """
    stamps: list[int | None] = []
    for number, line in enumerate(content.decode("ascii", "replace").rstrip().split("\n"), start=1):
        text = line.strip()
        stamps.append(_kitti_time(text, where, number) if text else None)
    return stamps


def _kitti_time(text: str, where: str, number: int) -> int:
    match = _KITTI_LINE.fullmatch(text)
    try:
        if match is not None:
            whole = datetime.fromisoformat(f"{match.group(1)}T{match.group(2)}").replace(tzinfo=UTC)
            return int(whole.timestamp()) * 1_000_000_000 + int((match.group(3) or "").ljust(9, "0"))
        if _NUMBER.fullmatch(text) and ("." in text or len(text) in UNITS_BY_DIGITS):
            unit_ns = 10**9 if "." in text else UNITS_BY_DIGITS[len(text)]
            stamp_ns = int(Decimal(text) * unit_ns)
            if stamp_ns <= _MAX_NS:
                return stamp_ns
    except (ValueError, OverflowError, ReadError):
        pass
    raise ReadError(
        "timestamps_malformed",
        f"{where}, line {number}: {text[:60]!r} is no time.",
        "Write times as 2011-09-26 13:02:25.964389445.",
    )


def kitti_stamps(times: Sequence[int | None], paths: Sequence[str]) -> Mapping[str, int]:
    """Stamps by path: a file's number is its line's, counted from 0, since KITTI leaves lost frames out.

    Files whose numbers do not count lines are taken in the order of their names, where there are as many.

    Raises:
        ReadError: ``timestamps_incomplete``.
    """
    numbers = [stem_and_number(path)[1] for path in paths]
    if all(text.isdigit() and len(text) < 19 and int(text) < len(times) for text in numbers):
        rows = [int(text) for text in numbers]
    elif len(times) == len(paths):
        rows = np.argsort(np.argsort(np.array(paths))).tolist()
    else:
        raise _unlisted(f"has {len(times)} lines for {len(paths)} files such as {paths[0]}.")
    every = {path: times[row] for path, row in zip(paths, rows, strict=True)}
    stamps = {path: stamp for path, stamp in every.items() if stamp is not None}
    if len(stamps) < len(paths):
        odd = next(path for path in paths if path not in stamps)
        raise _unlisted(f"has no line for {odd} ({len(paths) - len(stamps)} of {len(paths)} files are missing).")
    return stamps


def _unlisted(why: str) -> ReadError:
    return ReadError(
        "timestamps_incomplete",
        f"{KITTI_NAME} {why}",
        "Give one line per file in the order of the files' names, or number the files by line, from 0.",
    )


def listed_times(tables: Mapping[str, bytes]) -> Mapping[str, int]:
    """Stamps in nanoseconds, by path, of everything that the ``timestamps.csv`` files list.

    Args:
        tables: content by path; the paths inside are relative to the table's folder.

    Raises:
        ReadError: ``timestamps_malformed``.
    """
    stamps: dict[str, int] = {}
    for table_path, content in tables.items():
        folder = PurePosixPath(table_path).parent
        for number, row in enumerate(read_table(table_path, content, ("file", "stamp_ns")), start=2):
            path = (folder / (row.get("file") or "")).as_posix()
            stamps[path] = whole_ns(row.get("stamp_ns"), table_path, number)
    return stamps


def is_times_table(head: bytes) -> bool:
    """Whether a CSV file that begins with these bytes lists stamps of files."""
    names = head.split(b"\n", 1)[0].decode("utf-8-sig", "replace").strip("\r").split(",")
    return {"file", "stamp_ns"} <= {name.strip() for name in names}


def whole_ns(text: str | None, where: str, line: int) -> int:
    """A cell with nanoseconds since 1970.

    Raises:
        ReadError: ``timestamps_malformed``.
    """
    stripped = (text or "").strip()
    if not (stripped.isascii() and stripped.isdigit() and len(stripped) <= 19 and int(stripped) <= _MAX_NS):
        raise ReadError(
            "timestamps_malformed",
            f"{where}, line {line}: {stripped[:60]!r} is no integer of nanoseconds.",
            "Give stamp_ns as nanoseconds since 1970, digits only.",
        )
    return int(stripped)


def read_table(where: str, content: bytes, columns: Sequence[str]) -> Sequence[Mapping[str, str | None]]:
    """The rows of a CSV with a header line.

    Args:
        where: names the file in errors.
        content: the whole file, UTF-8.
        columns: what the header must have, at least.

    Raises:
        ReadError: ``timestamps_malformed``.
    """
    try:
        reader = csv.DictReader(io.StringIO(content.decode("utf-8-sig")), skipinitialspace=True)
        rows = list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise ReadError(
            "timestamps_malformed", f"{where} is no CSV text: {error}.", f"Save it as UTF-8 CSV: {','.join(columns)}."
        ) from error
    if not set(columns) <= set(reader.fieldnames or ()):
        raise ReadError(
            "timestamps_malformed",
            f"{where} should have the columns {' and '.join(columns)}; "
            f"it has {', '.join(reader.fieldnames or ())[:200]}.",
            f"Make its first line: {','.join(columns)}",
        )
    return rows
