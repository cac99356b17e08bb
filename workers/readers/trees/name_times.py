"""Times in the names of files: since 1970, as a date, or as whole seconds and a fraction."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Final, NamedTuple

import numpy as np

_DAY: Final = r"(?<!\d)(?P<date>(?:19|20)\d\d[-_.]?[01]\d[-_.]?[0-3]\d"
_MOMENT: Final = _DAY + r"[-_T ]{0,3}[0-2]\d[-_.:h]?[0-5]\d[-_.:m]?[0-6]\d)"
_DATE: Final = _MOMENT + r"(?:[-_.,:s]?(?P<of_date>\d{1,9}))?Z?"
_OF_SESSION: Final = re.compile(_MOMENT + r"[-_.,:s]?(?P<count>\d{1,9})$")
_OF_DAY: Final = re.compile(_DAY + r")[-_.]?(?P<count>\d{1,9})$")
_SECONDS: Final = r"(?<!\d)(?P<seconds>\d{10})[-_](?P<of_seconds>\d{1,9})"
_NUMBER: Final = r"(?P<number>\d+)(?:\.(?P<of_number>\d+))?"
_AT_END: Final = re.compile(f"(?:{_DATE}|{_SECONDS}|{_NUMBER})$")
# Digits of a time since 1970 in each unit, between the years 2001 and 2286.
UNITS_BY_DIGITS: Final = {10: 1_000_000_000, 13: 1_000_000, 16: 1_000, 19: 1}
_SECOND_NS: Final = 1_000_000_000
_LONGEST: Final = 80  # letters of a name in which its time stands
# Largest mean deviation of even steps between files, as a share of the usual step. Cameras and LiDARs have some per
# cent.
_EVEN: Final = 0.2
_LEAST_APART: Final = 0.05

ReadFraction = Callable[[str], int]


class SessionNumber(NamedTuple):
    """The parts of a file's name: the name before the session's date, the date's digits, and the file's number."""

    name: str
    date: str
    digits: str


def number_at_end(stem: str) -> str:
    """Return the time or the number with which a name without its suffix ends, or an empty text."""
    match = _match(stem[-_LONGEST:])
    return match.group(0) if match else ""


def is_time(text: str) -> bool:
    """Return whether a number in a name is a time.

    A number with a leading zero is a padded count: KITTI's have ten digits, as seconds since 1970 do.
    """
    match = _match(text)
    if match is None:
        return False
    number = match["number"]
    if number is None or match["of_number"] is not None:
        return True
    return len(number) in UNITS_BY_DIGITS and not number.startswith("0")


def session_numbers(stems: Sequence[str]) -> dict[str, SessionNumber]:
    """Split the names in one folder that consist of a session's date and the file's number.

    Digits behind a date are a number if most of them follow each other: no sensor is so fast that its times mostly
    differ by one in the last digit. Digits behind a date without a time of day are that time, unless the lowest is 0
    or 1, as counts begin.

    Returns:
        The parts by name; empty if most names are of another kind.
    """
    for pattern, highest_first in ((_OF_SESSION, None), (_OF_DAY, 1)):
        numbers = {stem: number for stem in stems if (number := _session_number(pattern, stem)) is not None}
        counts: dict[tuple[str, str], list[int]] = {}
        for name, date, number in numbers.values():
            counts.setdefault((name, date), []).append(int(number))
        steps = [step for each in counts.values() for step in np.diff(sorted(each)).tolist()]
        if 2 * len(numbers) <= len(stems) or not steps or np.median(steps) != 1:
            continue
        if highest_first is None or min(map(min, counts.values())) <= highest_first:
            return numbers
    return {}


def _session_number(pattern: re.Pattern[str], stem: str) -> SessionNumber | None:
    match = pattern.search(stem, max(0, len(stem) - _LONGEST))
    digits = "".join(filter(str.isdigit, match["date"])) if match else ""
    if match is None or _date_ns(digits.ljust(14, "0")) < 0:
        return None
    return SessionNumber(stem[: match.start()], digits, match["count"])


def time_ns(text: str, read: ReadFraction) -> int:
    """Return the nanoseconds since 1970 of a time in a name; dates count as UTC."""
    match = _match(text)
    assert match is not None
    if match["date"]:
        return _date_ns(match["date"]) + read(match["of_date"] or "")
    if match["seconds"]:
        return int(match["seconds"]) * _SECOND_NS + read(match["of_seconds"])
    if match["of_number"] is None:
        return int(match["number"]) * UNITS_BY_DIGITS[len(match["number"])]
    return int(match["number"]) * _SECOND_NS + read(match["of_number"])


def learn_fraction(texts: Sequence[str], every: Sequence[str]) -> ReadFraction | None:
    """Learn how to read the fractions of seconds in names: as decimals, or as a count without leading zeros.

    ``1700000000.5`` is half a second if a program cuts trailing zeros off, and 5 ns if it does not pad nanoseconds.
    Fractions of equal length are decimals. Of unequal ones, a leading zero occurs in decimals alone, a trailing zero
    in counts alone. Without either, the reading that makes the steps even is right.

    Args:
        texts: times in the names of one sensor's files.
        every: times in the names of all sensors' files; they decide if ``texts`` do not.

    Returns:
        None if nothing decides, or if names contradict each other.
    """
    own = [part for part in map(_part, texts) if part]
    if _are_counted(texts):
        return None
    if len({len(part) for part in own}) < 2:
        return _decimals
    for parts in (own, [part for part in map(_part, every) if part]):
        leads = any(part.startswith("0") and len(part) > 1 for part in parts)
        ends = any(part.endswith("0") and len(part) > 1 for part in parts)
        if leads != ends:
            return _decimals if leads else _count(own)
        if leads:
            return None
    spread = {read: _spread([time_ns(text, read) for text in texts]) for read in (_decimals, _count(own))}
    best, other = sorted(spread, key=lambda read: spread[read])
    return best if spread[best] < _EVEN and spread[other] > 2 * spread[best] + _LEAST_APART else None


def _are_counted(texts: Sequence[str]) -> bool:
    """Return whether the digits behind whole seconds number the files."""
    numbers = sorted(int(match["of_seconds"]) for text in texts if (match := _match(text)) and match["of_seconds"])
    is_whole = len(numbers) == len(texts) == len(set(numbers))
    return is_whole and len(numbers) > 2 and numbers[-1] - numbers[0] == len(numbers) - 1


def _match(text: str) -> re.Match[str] | None:
    match = _AT_END.search(text)
    if match and match["date"] and _date_ns(match["date"]) < 0:
        match = re.search(f"(?:{_SECONDS}|(?P<date>$.)|(?P<of_date>$.)|{_NUMBER})$", text)
    return match


def _date_ns(text: str) -> int:
    """Return nanoseconds since 1970; -1 if the digits are no date."""
    try:
        moment = datetime.strptime("".join(filter(str.isdigit, text)), "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    except ValueError:
        return -1
    return int(moment.timestamp()) * _SECOND_NS


def _part(text: str) -> str:
    match = _match(text)
    return (match["of_date"] or match["of_seconds"] or match["of_number"] or "") if match else ""


def _decimals(part: str) -> int:
    return int(part[:9].ljust(9, "0"))


def _count(parts: Sequence[str]) -> ReadFraction:
    """Return a reading of counts of milliseconds, microseconds or nanoseconds: the longest one tells the unit."""
    longest = max(map(len, parts), default=9)
    unit_ns = 1_000_000 if longest <= 3 else 1000 if longest <= 6 else 1
    return lambda part: int(part or "0") * unit_ns


def _spread(stamps: Sequence[int]) -> float:
    """Return the mean deviation of the steps between stamps from the median step, as a share of that."""
    steps = np.diff(np.sort(np.array(stamps, np.float64)))
    usual = float(np.median(steps)) if len(steps) > 1 else 0.0
    return float(np.mean(np.abs(steps - usual))) / usual if usual > 0 else float("inf")
