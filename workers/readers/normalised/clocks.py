"""Clocks of a recording's sensors, told by the times at which their messages were recorded.

A message's delay is its time of recording minus its stamp. It is a few milliseconds where sensor and recorder share a
clock, and nearly constant in any case. So a clock that steps shows as stamps that step while the recorder, or another
sensor, goes on; and two clocks that are apart show as two delays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.recordings import Gap

Integers = NDArray[np.int64]

# Delays of one sensor differ by less: half a turn of the slowest LiDAR that is read (0.5 Hz). Drivers hand on a sweep
# after its turn, and a camera's queue holds a few frames.
CLOCKS_APART_NS: Final = 1_000_000_000
# ntpd slews smaller offsets and steps larger ones (its option `tinker step`).
_LEAST_STEP_NS: Final = 128_000_000
# Messages whose least delay counts: a busy recorder hands messages on late, never early.
_AROUND: Final = 20
_FEW: Final = 5
_MOST_STEPS: Final = 20
_MOST_CHANGES: Final = 1000  # each is looked at
_LONGEST_PAUSE_NS: Final = 3600 * 10**9
_BY_CHANCE: Final = 6.0  # times the spread
_NORMAL: Final = 1.4826  # of a median absolute deviation
# Seconds between TAI, GPS time and UTC since 2017 (IERS Bulletin C). Delays differ by less than a quarter.
_TIME_SCALES: Final = {
    37: "TAI is 37 s ahead of UTC",
    18: "GPS time is 18 s ahead of UTC",
    19: "TAI is 19 s ahead of GPS time",
}
_NEAR_NS: Final = 250_000_000


class Times(NamedTuple):
    """One sensor's messages in recorded order, each (N,) int64: number among the messages of all sensors, stamp (ns)
    and time of recording (ns).
    """

    number: Integers
    stamp: Integers
    log: Integers


class Offset(NamedTuple):
    """A camera's clock minus the LiDAR's by the times of recording, and how far these spread (standard deviation)."""

    offset_ns: int
    spread_ns: int


@dataclass(slots=True)
class ClockReport:
    """The report on the clock of one sensor.

    Attributes:
        added_ns: (N,) int64, what makes one clock of its stamps.
        steps: its clock's steps, as they were stamped.
        offset: of a camera: where its clock is apart from the LiDAR's.
        step_sentences: about the steps, for the owner.
    """

    added_ns: Integers
    steps: list[Gap] = field(default_factory=list[Gap])
    offset: Offset | None = None
    step_sentences: list[str] = field(default_factory=list[str])

    def sentences(self, name: str) -> list[str]:
        """Return all sentences on a camera of this name, for the recording's page."""
        remedy = "Detect with this offset (`--offset-ms`) to get pairs."
        return self.step_sentences + ([f"{offset_sentence(name, self.offset)} {remedy}"] if self.offset else [])

    def moved(self, omitted_ns: Integers, stamps_ns: Integers) -> Integers:
        """(M,) stamps of messages that were left out, each moved as the nearest of the (N,) ``stamps_ns`` as read."""
        if not self.steps:
            return omitted_ns
        order = np.argsort(stamps_ns, kind="stable")
        behind = np.clip(np.searchsorted(stamps_ns[order], omitted_ns), 1, len(order) - 1)
        is_before = omitted_ns - stamps_ns[order[behind - 1]] < stamps_ns[order[behind]] - omitted_ns
        return omitted_ns + self.added_ns[order[np.where(is_before, behind - 1, behind)]]

    @property
    def offset_ns(self) -> int:
        """Return the ns to subtract from a camera's stamps to have them by the LiDAR's clock."""
        return self.offset.offset_ns if self.offset else 0


def report_clocks(sensors: Mapping[str, Times]) -> dict[str, ClockReport]:
    """Look at the clocks of sensors that one recorder recorded, the LiDAR first."""
    lidar, *cameras = sensors
    steady = _without_recorder_steps(sensors)
    steps = {name: _own_steps(times, steady[name]) for name, times in sensors.items()}
    is_common = len({tuple(size // _LEAST_STEP_NS for _, size in each) for each in steps.values()}) == 1
    reports: dict[str, ClockReport] = {}
    delays: dict[str, Integers] = {}
    for name, times in sensors.items():
        sizes = [size for _, size in steps[name]]
        added = np.zeros(len(times.stamp), np.int64)
        for index, size in steps[name]:
            added[index:] -= size
        if is_common:  # all went by one clock; that of a recorder that starts in 1970 learns the date later
            added += sum(sizes)
        delays[name] = steady[name] - times.stamp - added
        reports[name] = ClockReport(added)
    for name in () if is_common or not cameras else sensors:
        apart_ns = np.median(delays[cameras[0] if name == lidar else lidar]) - np.median(delays[name])
        shift = _reference(int(apart_ns), [size for _, size in steps[name]])
        reports[name].added_ns += shift
        delays[name] -= shift
    for name, times in sensors.items():
        report = reports[name]
        for index, size in steps[name]:
            report.steps.append(Gap(after_ns=int(times.stamp[index - 1]), duration_ns=size))
            report.step_sentences.append(_step_sentence(name, times, index, size, report.added_ns))
    for name in cameras:
        reports[name].offset = _offset(sensors[lidar].number, delays[lidar], sensors[name].number, delays[name])
    return reports


def offset_reports(samples: Mapping[str, Times]) -> dict[str, ClockReport]:
    """Look at clocks that do not step by some of the sensors' messages, the LiDAR first."""
    lidar, *cameras = samples.values()
    reports = {name: ClockReport(np.zeros(len(times.stamp), np.int64)) for name, times in samples.items()}
    for name, camera in zip(list(samples)[1:], cameras, strict=True):
        delays = lidar.log - lidar.stamp, camera.log - camera.stamp
        reports[name].offset = _offset(lidar.number, delays[0], camera.number, delays[1])
    return reports


def offset_sentence(name: str, offset: Offset) -> str:
    """Say how far a camera's clock is from the LiDAR's, and which time scale it may keep."""
    seconds = offset.offset_ns / 1e9
    scales = _TIME_SCALES.get(abs(offset.offset_ns) // 10**9) if offset.offset_ns % 10**9 == 0 else None
    usual = f" ({scales})" if scales else ""
    return (
        f"The clock of {name} is {abs(seconds):.3f} s {'ahead of' if seconds > 0 else 'behind'} the LiDAR's, by the "
        f"times of recording, which spread by {offset.spread_ns / 1e9:.3f} s{usual}."
    )


def _step_sentence(name: str, times: Times, index: int, size: int, added: Integers) -> str:
    before, after = int(added[index - 1]), int(added[index])
    at_s, first_s = times.stamp[index - 1] / 1e9, times.stamp[0] / 1e9
    moved, count, by = ("behind", len(added) - index, after) if after else ("before", index, before)
    return (
        f"The clock of {name} steps by {size / 1e9:+.3f} s after {at_s:.3f} s, {at_s - first_s:.1f} s after its "
        f"first message. The {count} messages {moved} it were shifted by {by / 1e9:+.3f} s, to one clock."
    )


def _reference(apart_ns: int, steps: Sequence[int]) -> int:
    """Return the ns to add to all stamps, so that the stretch nearest to the other sensor's clock keeps its stamps.

    Args:
        apart_ns: this sensor's clock minus the other's before the first step.
        steps: of this sensor's clock, ns.
    """
    past = np.cumsum([0, *steps])
    return int(past[np.argmin(np.abs(apart_ns + past))])


def _without_recorder_steps(sensors: Mapping[str, Times]) -> dict[str, Integers]:
    """The sensors' times of recording by a clock that does not step, as far as a sensor tells that it does.

    If the recorder's clock steps, the delays of a sensor whose stamps go on regularly step. If no sensor's do, they
    all go by the recorder's clock: it was set back, or learned the date.
    """
    number = np.concatenate([times.number for times in sensors.values()])
    order = np.argsort(number, kind="stable")
    number, log = number[order], np.concatenate([times.log for times in sensors.values()])[order]
    progress, lidar = np.diff(log), next(iter(sensors.values()))
    steps: dict[int, int] = {}
    for times in sensors.values():
        delay = times.log - times.stamp
        for index in _changes(times.stamp, delay, is_own=False):
            size = _level_shift(delay, index)
            first, last = np.searchsorted(number, times.number[[index - 1, index]])
            if size and last > first:
                steps.setdefault(int(first + np.argmax(np.abs(progress[first:last]))), size)
    # Where a file holds one sensor's messages after another's, only the order goes back in time.
    moved = np.diff(lidar.log)
    moves = np.flatnonzero((moved < -_LEAST_STEP_NS) | (moved > _LONGEST_PAUSE_NS))
    for before in moves[:_MOST_CHANGES].tolist():
        if len(steps) >= _MOST_STEPS:
            break
        first, last = np.searchsorted(number, lidar.number[[before, before + 1]])
        index = int(first + np.argmax(np.abs(progress[first:last])))
        if not any(abs(index - other) < _AROUND for other in steps):
            steps[index] = int(moved[before]) - _period(lidar.stamp)
    shift = np.zeros(len(log), np.int64)
    for index, size in list(steps.items())[:_MOST_STEPS]:
        shift[index + 1 :] += size
    return {name: times.log - shift[np.searchsorted(number, times.number)] for name, times in sensors.items()}


def _changes(stamps: Integers, delay: Integers, *, is_own: bool) -> list[int]:
    """The messages behind those at which the delay changes because stamps step, or although they do not."""
    change, progress = np.abs(np.diff(delay)), np.diff(stamps)
    irregular = 2 * np.abs(progress - _period(stamps)) > change
    changes = np.flatnonzero((change > _LEAST_STEP_NS) & (irregular if is_own else ~irregular)) + 1
    return changes[:_MOST_CHANGES].tolist()


def _own_steps(times: Times, log: Integers) -> list[tuple[int, int]]:
    """(first message behind it, size in ns) of each step of a sensor's clock; ``log`` does not step."""
    usual, delay = _period(times.stamp), log - times.stamp
    steps: list[tuple[int, int]] = []
    for index in _changes(times.stamp, delay, is_own=True):
        size = -_level_shift(delay, index)
        if size and len(steps) < _MOST_STEPS:
            # Stamps are more regular than times of recording.
            progress = int(times.stamp[index] - times.stamp[index - 1])
            exact = progress - round((progress - size) / usual) * usual if usual else size
            steps.append((index, exact if progress - exact > 0 and abs(exact - size) < usual / 4 else size))
    return steps


def _level_shift(delay: Integers, index: int) -> int:
    """Return the difference of the least delays before and behind an index, ns; 0 if it may be chance."""
    before, behind = delay[max(0, index - _AROUND) : index], delay[index : index + _AROUND]
    shift = int(behind.min() - before.min())
    spread = max(_spread(before), _spread(behind))
    least = CLOCKS_APART_NS if min(len(before), len(behind)) < _FEW else _LEAST_STEP_NS
    return shift if abs(shift) > max(least, _BY_CHANCE * spread) else 0


def _offset(lidar_number: Integers, lidar: Integers, number: Integers, camera: Integers) -> Offset | None:
    """A camera's clock minus the LiDAR's, if they are apart: each frame's delay and that of a sweep beside it.

    Delays grow from tick to tick where a simulator is slower than the clock on the wall. Which of the two sweeps is
    of the frame's tick depends on who is written first: the nearer delay counts.
    """
    behind = np.searchsorted(lidar_number, number)
    before = lidar[np.maximum(behind - 1, 0)] - camera
    after = lidar[np.minimum(behind, len(lidar) - 1)] - camera
    apart: Integers = np.where(np.abs(after) < np.abs(before), after, before)
    apart_ns = int(np.median(apart))
    scale_ns = next((size * 10**9 for size in _TIME_SCALES if abs(abs(apart_ns) - size * 10**9) < _NEAR_NS), None)
    offset = Offset(apart_ns if scale_ns is None else scale_ns * (1 if apart_ns > 0 else -1), int(_spread(apart)))
    is_apart = abs(offset.offset_ns) > max(CLOCKS_APART_NS, _BY_CHANCE * offset.spread_ns)
    return offset if is_apart else None


def _spread(values: Integers) -> float:
    middle = np.median(values)
    return _NORMAL * float(np.median(np.abs(values - middle)))


def _period(stamps: Integers) -> int:
    return int(np.median(np.diff(stamps))) if len(stamps) > 1 else 0
