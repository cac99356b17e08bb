"""The moment of each point: from the file's field where it has one, else from azimuth and rate.

Fields come in seconds to nanoseconds, relative to the stamp or absolute. Which it is follows from how long a sweep
lasts: its points span at most two turns and at least a hundredth of one, and units lie a factor of 1000 apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.readings import ReadOptions
from workers.readers.recording import StampConvention, TimeSource

_UNITS: Final = {"seconds": 1e9, "milliseconds": 1e6, "microseconds": 1e3, "nanoseconds": 1.0}
_USUAL_RATES_HZ: Final = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0)
_DEFAULT_PERIOD_NS: Final = 100_000_000
_LIMIT_NS: Final = 2**31 - 1

Base = Literal["stamp", "epoch", "other_clock"]
# (stamp, times as in the file or None, (N, 3) points, (N,) ring numbers)
Sample = tuple[int, NDArray[np.generic] | None, NDArray[np.float32], NDArray[np.int32]]


@dataclass(slots=True)
class PointTimes:
    """The rule for the moment of each point of one LiDAR.

    Attributes:
        source: where the offsets come from.
        sweep_ns: duration of one turn.
        stamp_convention: whether offsets count from the start or the end of a sweep.
        unit_ns: nanoseconds in one unit of the file's field.
        base: what the field counts from.
        direction: +1 where azimuth grows with time, -1 (most sensors) where it falls.
        notes: sentences about what was found and assumed.
    """

    source: TimeSource
    sweep_ns: int
    stamp_convention: StampConvention
    unit_ns: float = 1.0
    base: Base = "stamp"
    direction: int = 0
    notes: list[str] = field(default_factory=list[str])
    clipped: int = 0

    def offsets(
        self, stamp_ns: int, time: NDArray[np.generic] | None, xyz: NDArray[np.float32], ring: NDArray[np.int32]
    ) -> NDArray[np.int64]:
        """(N,) int64 nanoseconds from the stamp to the moment of each point."""
        if self.source == "derived_from_azimuth":
            turn = turns(xyz, ring, self.direction) if len(xyz) else np.zeros(0)
            offset = np.rint(turn * self.sweep_ns).astype(np.int64)
            return offset - self.sweep_ns if self.stamp_convention == "end" else offset
        if self.source == "stamp_only" or time is None:
            return np.zeros(len(xyz), np.int64)
        offset = to_offsets(stamp_ns, time, self.unit_ns, self.base)
        if len(offset) and max(int(offset.max()), -int(offset.min())) > _LIMIT_NS:
            self.clipped += 1
            offset = np.clip(offset, -_LIMIT_NS, _LIMIT_NS)
        return offset

    def warnings(self) -> list[str]:
        """Sentences about what was met while reading."""
        if not self.clipped:
            return []
        return [f"{self.clipped} sweeps hold points timed more than 2 s from their stamp; these times are wrong."]


def to_offsets(stamp_ns: int, time: NDArray[np.generic], unit_ns: float, base: Base) -> NDArray[np.int64]:
    """(N,) int64 nanoseconds from the stamp, from a file's time field.

    A float64 of seconds since 1970 resolves 0.2 us, but not its product with 1e9: whole seconds go separately.
    """
    if not len(time):
        return np.zeros(0, np.int64)
    if np.issubdtype(time.dtype, np.integer):
        whole = int(time.min())
        rest = (time.astype(np.int64) - np.int64(whole)).astype(np.float64)
    else:
        seconds = time.astype(np.float64)
        finite = np.isfinite(seconds)
        whole = int(np.floor(seconds[finite].min())) if finite.any() else 0
        rest = np.where(finite, seconds - whole, 0.0)
    start = whole * int(unit_ns)
    if base == "epoch":
        start -= stamp_ns
    elif base == "other_clock":
        start = 0
        rest = rest - rest.min()
    return np.rint(np.clip(rest * unit_ns + float(start), -(2.0**62), 2.0**62)).astype(np.int64)


def turns(xyz: NDArray[np.float32], ring: NDArray[np.int32], direction: int) -> NDArray[np.float64]:
    """(N,) float64, how far the sensor had turned when it measured each point; 0 at the sweep's first point.

    A sweep may overlap itself by some degrees. The order of the points within their ring tells the overlap's two
    ends apart.
    """
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0], dtype=np.float64) / (2 * np.pi)
    order = np.argsort(ring.astype(np.uint16), kind="stable")  # 16 bits: a radix sort
    sorted_ring = ring[order]
    starts = np.flatnonzero(np.r_[True, np.diff(sorted_ring) != 0])
    sizes = np.diff(np.r_[starts, len(ring)])
    share = np.empty(len(ring))
    share[order] = (np.arange(len(ring)) - np.repeat(starts, sizes)) / np.repeat(sizes, sizes)
    longest = order[starts[np.argmax(sizes)]]
    turn = np.mod((azimuth - azimuth[longest]) * direction, 1.0)
    turn = np.where((share < 0.25) & (turn > 0.9), turn - 1.0, turn)
    return np.where((share > 0.75) & (turn < 0.1), turn + 1.0, turn)


def learn_point_times(
    samples: Sequence[Sample],
    period_ns: int | None,
    options: ReadOptions,
    where: str,
    unit_ns: float | None = None,
) -> PointTimes:
    """Learn from sample clouds how the moment of each point is found.

    Args:
        samples: clouds spread over the recording.
        period_ns: time from one sweep to the next by the stamps, None where they do not tell.
        options: what the owner knows.
        where: names the LiDAR in notes.
        unit_ns: nanoseconds in one unit of the times, where the field's name says it.
    """
    stated: StampConvention = options.stamp_convention or "unknown"
    sweep_ns, notes = _sweep_duration(period_ns, options, where)
    if options.point_times == "stamp_only":
        return PointTimes("stamp_only", sweep_ns, stated, notes=notes)
    timed = [(stamp, time) for stamp, time, _, _ in samples if time is not None and len(time) > 1]
    if timed:
        learned = _from_field(timed, sweep_ns, stated, where, unit_ns)
        if learned is not None:
            learned.notes[:0] = notes
            return learned
        notes.append(
            f"{where}: the points' time field fits no unit (a sweep lasts about {sweep_ns / 1e6:.0f} ms); "
            "times were derived from the azimuth instead."
        )
    direction = _direction(samples)
    if direction == 0:
        notes.append(
            f"{where}: points have no times, and their order does not follow the azimuth, so none can be derived; "
            "each sweep is taken as one moment."
        )
        return PointTimes("stamp_only", sweep_ns, stated, notes=notes)
    if stated == "unknown":
        notes.append(
            f"{where}: points have no times. They were derived from the azimuth, with a turn of {sweep_ns / 1e6:.1f} "
            "ms from the stamp on; whether the stamp is the sweep's start, the file does not say."
        )
    return PointTimes("derived_from_azimuth", sweep_ns, stated, direction=direction, notes=notes)


def _sweep_duration(period_ns: int | None, options: ReadOptions, where: str) -> tuple[int, list[str]]:
    if options.rate_hz is not None:
        return round(1e9 / options.rate_hz), []
    if period_ns is not None and period_ns > 0:
        rate = 1e9 / period_ns
        if any(abs(rate - usual) < 0.15 * usual for usual in _USUAL_RATES_HZ):
            return period_ns, []
    pace = "stamps tell no rate" if not period_ns else f"sweeps come every {period_ns / 1e9:.3g} s"
    return _DEFAULT_PERIOD_NS, [f"{where}: {pace}; a turn was taken to last 100 ms."]


def _from_field(
    timed: Sequence[tuple[int, NDArray[np.generic]]],
    sweep_ns: int,
    stated: StampConvention,
    where: str,
    named_ns: float | None,
) -> PointTimes | None:
    spans = [float(np.nanmax(t)) - float(np.nanmin(t)) for _, t in _as_floats(timed)]
    span = float(np.median(spans))
    # A name that states its unit may have times of less than a five-hundredth of a turn, not of more than two.
    fits = [
        (name, ns)
        for name, ns in _UNITS.items()
        if (0 if ns == named_ns else sweep_ns / 500) < span * ns <= 2 * sweep_ns
    ]
    fits.sort(key=lambda fit: fit[1] != named_ns)
    if not fits:
        return None
    name, unit_ns = fits[0]
    first_stamp, first_time = timed[0]
    base: Base = "stamp"
    meaning = "relative to the stamp"
    middles = [float(np.nanmedian(time.astype(np.float64))) * unit_ns for _, time in (timed[0], timed[-1])]
    # Times of a sensor that counts from its start may be small, but they grow from sweep to sweep.
    apart_ns = timed[-1][0] - first_stamp
    is_growing = abs(apart_ns) > sweep_ns / 2 and (middles[1] - middles[0]) / apart_ns > 0.5
    if is_growing or abs(middles[0]) > 20 * sweep_ns:
        base, meaning = "epoch", "absolute"
        if abs(float(np.median(to_offsets(first_stamp, first_time, unit_ns, base)))) > 5 * sweep_ns:
            base = "other_clock"
            meaning = "absolute on another clock than the stamps; the sweep's first point was put at the stamp"
    convention: StampConvention = stated
    if stated == "unknown" and base != "other_clock":
        convention = _convention([to_offsets(stamp, t, unit_ns, base) for stamp, t in timed], sweep_ns)
    note = f"{where}: points carry their times, in {name}, {meaning}; a sweep spans {span * unit_ns / 1e6:.1f} ms."
    return PointTimes("per_point", sweep_ns, convention, unit_ns, base, notes=[note])


def _convention(offsets: Sequence[NDArray[np.int64]], sweep_ns: int) -> StampConvention:
    """Whether points come after their stamp or before it, with a twentieth of a turn for jitter."""
    first = float(np.median([o.min() for o in offsets]))
    last = float(np.median([o.max() for o in offsets]))
    if first > -0.05 * sweep_ns:
        return "start"
    return "end" if last < 0.05 * sweep_ns else "unknown"


def _as_floats(timed: Sequence[tuple[int, NDArray[np.generic]]]) -> list[tuple[int, NDArray[np.float64]]]:
    """Times less their own minimum, so that large integers keep their differences in float64."""
    return [(stamp, np.asarray(time - np.nanmin(time), np.float64)) for stamp, time in timed]  # pyright: ignore[reportOperatorIssue]


def _direction(samples: Sequence[Sample]) -> int:
    """+1 or -1, the sense in which azimuth runs within a ring; 0 where points are in no such order."""
    rising = falling = 0
    for _, _, xyz, ring in samples:
        if len(xyz) < 2:
            continue
        order = np.argsort(ring, kind="stable")
        azimuth = np.arctan2(xyz[order, 1], xyz[order, 0]).astype(np.float64)
        same_ring = np.diff(ring[order]) == 0
        step = np.mod(np.diff(azimuth)[same_ring] + np.pi, 2 * np.pi) - np.pi
        rising += int(np.count_nonzero(step > 0))
        falling += int(np.count_nonzero(step < 0))
    if rising + falling == 0 or max(rising, falling) < 0.9 * (rising + falling):
        return 0
    return 1 if rising > falling else -1
