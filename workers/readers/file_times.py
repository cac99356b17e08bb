"""The stamps of a folder's files: from ``timestamps.csv``, from times in their names, or from numbers in them."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import PurePosixPath
from typing import Final, Literal

from workers.readers.recording import ReadError

CSV_NAME: Final = "timestamps.csv"
_NUMBER_AT_END: Final = re.compile(r"(\d+(?:\.\d+)?)$")
# Digits of a time since 1970 in each unit, between the years 2001 and 2286.
_UNITS_BY_DIGITS: Final = {10: 1_000_000_000, 13: 1_000_000, 16: 1_000, 19: 1}
_INDEX_STEP_NS: Final = 100_000_000
# Not 0, which ROS reads as "no stamp".
_INDEX_START_NS: Final = 1_000_000_000


@dataclass(frozen=True, slots=True)
class FileTimes:
    """Stamps of a folder's files.

    Attributes:
        stamps_ns: by path.
        source: ``csv``, ``names``, or ``index`` where names hold only numbers and the times are made up.
        warnings: sentences about what was assumed.
    """

    stamps_ns: Mapping[str, int]
    source: Literal["csv", "names", "index"]
    warnings: Sequence[str]


def stem_and_number(path: str) -> tuple[str, str]:
    """A file's name split before the number at its end: ``a/pose12.pcd`` gives (``pose``, ``12``)."""
    stem = PurePosixPath(path).name.rpartition(".")[0]
    match = _NUMBER_AT_END.search(stem)
    return (stem[: match.start()], match.group(1)) if match else (stem, "")


def stamp_files(paths: Sequence[str], tables: Mapping[str, bytes]) -> FileTimes:
    """The stamp of every file.

    Args:
        paths: the point clouds and images of the recording.
        tables: content of every ``timestamps.csv`` by its path.

    Raises:
        ReadError: ``timestamps_incomplete``, ``timestamps_malformed``, ``files_without_times``.
    """
    if tables:
        return _from_tables(paths, tables)
    texts = {path: stem_and_number(path)[1] for path in paths}
    nameless = [path for path, text in texts.items() if not text]
    if nameless:
        raise ReadError(
            "files_without_times",
            f"The name of {nameless[0]} ends in no number ({len(nameless)} of {len(paths)} files).",
            f"Name files by their time (1600000000123456789.png), by a number (pose12.png), or add {CSV_NAME} "
            "with the columns file,stamp_ns.",
        )
    if all("." in text or len(text) in _UNITS_BY_DIGITS for text in texts.values()):
        return FileTimes({path: _time(text) for path, text in texts.items()}, "names", ())
    if any("." in text for text in texts.values()):
        odd = next(path for path, text in texts.items() if "." not in text and len(text) not in _UNITS_BY_DIGITS)
        raise ReadError(
            "files_without_times",
            f"Some files are named by their time, but {odd} is not.",
            f"Name all files in the same way, or add {CSV_NAME} with the columns file,stamp_ns.",
        )
    return FileTimes(
        {path: _INDEX_START_NS + int(text) * _INDEX_STEP_NS for path, text in texts.items()},
        "index",
        (
            "File names hold numbers and no times: files of equal number are taken as simultaneous, and the times, "
            "0.1 s from number to number, are made up.",
        ),
    )


def _time(text: str) -> int:
    if "." in text:
        return int(Decimal(text) * 1_000_000_000)
    return int(text) * _UNITS_BY_DIGITS[len(text)]


def _from_tables(paths: Sequence[str], tables: Mapping[str, bytes]) -> FileTimes:
    stamps: dict[str, int] = {}
    for table_path, content in tables.items():
        folder = PurePosixPath(table_path).parent
        for number, row in enumerate(_rows(table_path, content), start=2):
            path = (folder / (row.get("file") or "")).as_posix()
            try:
                stamps[path] = int(row.get("stamp_ns") or "")
            except ValueError:
                raise ReadError(
                    "timestamps_malformed",
                    f"{table_path}, line {number}: {row.get('stamp_ns')!r} is no integer of nanoseconds.",
                    "Give stamp_ns as nanoseconds since 1970, digits only.",
                ) from None
    missing = [path for path in paths if path not in stamps]
    if missing:
        raise ReadError(
            "timestamps_incomplete",
            f"{CSV_NAME} has no line for {missing[0]} ({len(missing)} of {len(paths)} files are missing).",
            f"List every file, its path relative to the folder of {CSV_NAME}.",
        )
    return FileTimes({path: stamps[path] for path in paths}, "csv", ())


def _rows(table_path: str, content: bytes) -> Sequence[Mapping[str, str | None]]:
    try:
        reader = csv.DictReader(io.StringIO(content.decode("utf-8-sig")), skipinitialspace=True)
        rows = list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise ReadError(
            "timestamps_malformed", f"{table_path} is no CSV text: {error}.", "Save it as UTF-8 CSV: file,stamp_ns."
        ) from error
    if not {"file", "stamp_ns"} <= set(reader.fieldnames or ()):
        raise ReadError(
            "timestamps_malformed",
            f"{table_path} should have the columns file and stamp_ns; it has {', '.join(reader.fieldnames or ())}.",
            "Make its first line: file,stamp_ns",
        )
    return rows
