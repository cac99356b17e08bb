"""Sweeps cut again at another azimuth, if a driver cuts them within the region.

A board across the driver's cut angle is seen at the beginning of a sweep and at its end, a turn apart in time. The
end of a sweep is joined with the beginning of the next one, and cut where no board can be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import Options
from workers.readers.recording import Sweep
from workers.vertices.region import Region
from workers.vertices.sweep_source import OnSweep, SweepSource, spread
from workers.vertices.vertex import Answers, Rejection, Vertex

Floats = NDArray[np.float64]
Part = tuple[Sweep, NDArray[np.bool_], int]
# Looks for the apex in each sweep of a range, as `sweep_source.Run` does, in a region.
Run = Callable[[SweepSource, Region, Options, range, OnSweep], Answers]

_SAMPLES: Final = 12
_BINS: Final = 72  # of 5 degrees
_AROUND: Final = 4  # bins to either side: a board of 1.4 m nearly 2 m away, half of it
_RANGES_M: Final = np.geomspace(1.0, 100.0, 24)
_ELEVATIONS: Final = 12
_FEWEST: Final = 50
_ONE_SHOT_RAD: Final = math.radians(3.0)  # neighbouring returns of a ring; farther apart is a gap
_TURNS_S: Final = (0.01, 1.0)
# Turns between the stamps of consecutive sweeps. With more, a sweep is missing; with fewer, a sweep was recorded
# twice, or its clock was set back.
_NEXT: Final = (0.5, 1.5)


@dataclass(frozen=True, slots=True)
class Cut:
    """The place where sweeps are cut.

    Attributes:
        azimuth: radians.
        direction: +1 where azimuth grows with time, -1 where it falls.
        turn_ns: duration of a turn.
    """

    azimuth: float
    direction: int
    turn_ns: float

    def early(self, sweep: Sweep) -> NDArray[np.bool_]:
        """Return which points (N,) were measured before the sensor first looked along the cut."""
        if not len(sweep.xyz):
            return np.zeros(0, np.bool_)
        until = (
            self.turn_ns
            * ((self.azimuth - _first_azimuth(sweep)) * self.direction % (2.0 * math.pi))
            / (2.0 * math.pi)
        )
        return sweep.offset_ns < int(sweep.offset_ns.min()) + until


def find_cut(source: SweepSource, region: Region) -> Cut | None:
    """Return where to cut sweeps again; None if the cut angle is outside of the region, or points have no times."""
    count = len(source)
    numbers = spread(count, _SAMPLES) if count > 1 else []
    sweeps = [sweep for sweep in map(source.sweep, numbers) if len(sweep.xyz) and sweep.time_source != "stamp_only"]
    if not sweeps:
        return None
    counts = _neighbour_sums(sum((_histogram(sweep, region) for sweep in sweeps), np.zeros(_BINS)))
    possible = _neighbour_sums(_visible_places(sweeps, region))
    cut_bins = {int(_bin(np.array([begins]))[0]) for begins in map(_first_azimuth, sweeps) if math.isfinite(begins)}
    if not any(counts[k] or possible[k] for k in cut_bins):
        return None
    turning = _turning(sweeps)
    if turning is None:
        return None
    middles = (np.arange(_BINS) + 0.5) * 2.0 * math.pi / _BINS - math.pi
    opposite = np.cos(middles[:, None] - middles) @ counts
    best = min(range(_BINS), key=lambda k: (counts[k], possible[k], opposite[k]))
    returns = sum((_counted(sweep.xyz) for sweep in sweeps), np.zeros(_BINS))
    if not any(
        (counts[k], possible[k]) > (counts[best], possible[best]) and _both_sides(returns, k) for k in cut_bins
    ):
        return None
    return Cut(float(middles[best]), *turning)


def run_cut(
    source: SweepSource, region: Region, cut: Cut, run: Run, options: Options, indices: range, on_sweep: OnSweep
) -> Answers:
    """Return a detector's answers for the sweeps ``indices``, found in the pieces between two cuts.

    A vertex belongs to the sweep in which the sensor looked at it. If a sweep gets two, the one with the smaller
    variance is kept.
    """
    pieces = Pieces(source, cut)
    answers = run(pieces, region, options, range(indices.start, indices.stop + 1), on_sweep)
    vertices: dict[int, Vertex] = {}
    rejections: dict[int, Rejection] = {}
    nothing = Rejection("no_points")
    for number, answer in zip(range(indices.start, indices.stop + 1), answers.outcomes, strict=True):
        if isinstance(answer, Rejection):
            for index in (number - 1, number):
                if rejections.get(index, nothing) == nothing:
                    rejections[index] = answer
            continue
        sweep_of = pieces.sweep_of(number, answer.time_ns)
        if sweep_of not in vertices or _variance(answer) < _variance(vertices[sweep_of]):
            vertices[sweep_of] = replace(answer, sweep_index=sweep_of)
    outcomes = [vertices.get(index) or rejections.get(index, nothing) for index in indices]
    return replace(answers, outcomes=outcomes)


class Pieces:
    """The pieces between two cuts as a source: piece k is the end of sweep k - 1 and the beginning of sweep k."""

    def __init__(self, source: SweepSource, cut: Cut) -> None:
        self._source = source
        self._cut = cut
        self._parts: dict[int, Part] = {}

    def __len__(self) -> int:
        return len(self._source) + 1

    def sweep(self, index: int) -> Sweep:
        """Return piece ``index``; only its larger part if a sweep is missing or recorded twice."""
        before = self._part(index - 1) if index > 0 else None
        after = self._part(index) if index < len(self._source) else None
        late = None if before is None else _select(before[0], ~before[1])
        early = None if after is None else _select(after[0], after[1])
        if late is None or early is None:
            whole = late or early
            assert whole is not None
            return whole
        apart_ns = early.stamp_ns - late.stamp_ns
        if not _NEXT[0] < apart_ns / self._cut.turn_ns <= _NEXT[1]:
            return max(late, early, key=lambda part: len(part.xyz))
        return Sweep(
            stamp_ns=late.stamp_ns,
            xyz=np.concatenate([late.xyz, early.xyz]),
            intensity=np.concatenate([late.intensity, early.intensity]),
            ring=np.concatenate([late.ring, early.ring]),
            offset_ns=np.concatenate([late.offset_ns, early.offset_ns + apart_ns]),
            time_source=late.time_source,
        )

    def sweep_of(self, index: int, time_ns: int) -> int:
        """Return the index of the sweep in which a moment of piece ``index`` lies."""
        if index == len(self._source):
            return index - 1
        return index if index == 0 or time_ns >= self._part(index)[2] else index - 1

    def _part(self, index: int) -> Part:
        """Return a sweep, which of its points come before the cut, and the time of its first point."""
        if index not in self._parts:
            sweep = self._source.sweep(index)
            first_ns = sweep.stamp_ns + (int(sweep.offset_ns.min()) if len(sweep.xyz) else 0)
            for old in [number for number in self._parts if abs(number - index) > 1]:
                del self._parts[old]
            self._parts[index] = sweep, self._cut.early(sweep), first_ns
        return self._parts[index]


def _select(sweep: Sweep, chosen: NDArray[np.bool_]) -> Sweep:
    return replace(
        sweep,
        xyz=sweep.xyz[chosen],
        intensity=sweep.intensity[chosen],
        ring=sweep.ring[chosen],
        offset_ns=sweep.offset_ns[chosen],
    )


def _variance(vertex: Vertex) -> float:
    return math.inf if vertex.covariance is None else vertex.covariance[0][0] + vertex.covariance[1][1]


def _first_azimuth(sweep: Sweep) -> float:
    """Return the azimuth of the first point in time, radians."""
    x, y, _ = sweep.xyz[int(np.argmin(sweep.offset_ns))].tolist()
    return math.atan2(y, x)


def _turning(sweeps: Iterable[Sweep]) -> tuple[int, float] | None:
    """Return sense and duration (ns) of the turn; None if the points' times do not follow the azimuth."""
    rates: list[Floats] = [np.zeros(0)]
    for sweep in sweeps:
        order = np.lexsort((sweep.offset_ns, sweep.ring))
        azimuth = np.arctan2(sweep.xyz[order, 1], sweep.xyz[order, 0]).astype(np.float64)
        turned = np.remainder(np.diff(azimuth) + math.pi, 2.0 * math.pi) - math.pi
        later = np.diff(sweep.offset_ns[order])
        usable = (np.diff(sweep.ring[order].astype(np.int64)) == 0) & (later > 0)
        usable &= (np.abs(turned) < _ONE_SHOT_RAD) & (turned != 0.0)
        rates.append(turned[usable] / later[usable])
    rate = np.concatenate(rates)
    if rate.size < _FEWEST:
        return None
    direction = 1 if np.median(rate) > 0.0 else -1
    turn_ns = 2.0 * math.pi / float(abs(np.median(rate)))
    steady = np.mean(rate * direction > 0.0) > 0.9 and _TURNS_S[0] < turn_ns * 1e-9 < _TURNS_S[1]
    return (direction, turn_ns) if steady else None


def _bin(azimuth: Floats) -> NDArray[np.int64]:
    return np.floor((azimuth / (2.0 * math.pi) + 0.5) * _BINS).astype(np.int64) % _BINS


def _histogram(sweep: Sweep, region: Region) -> Floats:
    """Return (B,) the number of returns in the region."""
    return _counted(sweep.xyz[region.mask(sweep.xyz)])


def _counted(xyz: NDArray[np.float32]) -> Floats:
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0]).astype(np.float64)
    return np.bincount(_bin(azimuth), minlength=_BINS).astype(np.float64)


def _both_sides(returns: Floats, cut_bin: int) -> bool:
    """Return whether the sensor looks to both sides of the cut angle; a sensor that is set to a sector does not."""
    beside = np.arange(1, _AROUND + 1)
    return all(bool(returns[(cut_bin + sign * beside) % _BINS].any()) for sign in (-1, 1))


def _visible_places(sweeps: Sequence[Sweep], region: Region) -> Floats:
    """Return (B,) the number of places in the region that the sensor can see."""
    xyz = np.concatenate([sweep.xyz for sweep in sweeps]).astype(np.float64)
    with np.errstate(invalid="ignore"):
        slope = xyz[:, 2] / np.maximum(np.hypot(xyz[:, 0], xyz[:, 1]), 1e-3)
    slope = np.sort(slope[np.isfinite(slope)])
    if not slope.size:
        return np.zeros(_BINS)
    # Quantiles; `np.quantile` takes ten times as long.
    slopes = np.interp(np.linspace(0.0, slope.size - 1.0, _ELEVATIONS), np.arange(slope.size), slope)
    azimuth = (np.arange(_BINS) + 0.5) * 2.0 * math.pi / _BINS - math.pi
    a, h, k = (part.ravel() for part in np.meshgrid(azimuth, _RANGES_M, slopes, indexing="ij"))
    inside = region.mask(np.column_stack([h * np.cos(a), h * np.sin(a), h * k]))
    return inside.reshape(_BINS, -1).sum(axis=1).astype(np.float64)


def _neighbour_sums(counts: Floats) -> Floats:
    """Return (B,) sums over the bins beside each one."""
    return np.sum([np.roll(counts, shift) for shift in range(-_AROUND, _AROUND + 1)], axis=0)
