"""Whether a LiDAR can have measured a recording's sweeps, judged once, after reading, from sweeps spread over it.

Misread columns, units and tables make numbers that no later step doubts. Each test is a limit of what sensors do, far
from what any does; its reason stands beside its constant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.inspections import RecordingFault
from workers.readers.recording import ReadError, Sweep

_MOST_SWEEPS: Final = 16
_RUNS, _RUN = 25, 40
# Makers state 0.1 m (Livox Mid-360) to 1 m (Velodyne VLP-16) as the nearest range. A robot that sees itself does so
# with some of its points. docs/constants.md lists the sources.
_NEAREST_M: Final = 0.3
_NEAR_SHARE: Final = 0.5
# The farthest of all points lies beyond this, in the smallest room that a board fits into.
_SMALLEST_M: Final = 1.0
# A sensor that sees a board sees the ground or the room about it as well: from 3 m above the ground a ray six degrees
# below the horizon has 29 m, one degree 170 m.
_FARTHEST_MEDIAN_M: Final = 150.0
_NEXT_SHARE, _NEXT_M = 0.05, 40.0
_FARTHEST_MISREAD_M: Final = 1e7  # in millimetres 10 km, in no unit of LiDARs less
# Data sheets state a noise (one sigma) of 5 mm and more; two rings meet a wall at different heights.
_FLAT_M: Final = 0.005
_FLAT_SHARE: Final = 0.95
# Rays of one elevation, zero, lie in a plane through their origin; it is 36 mm above an Ouster's base. A flat floor
# lies farther below any sensor.
_ORIGIN_M: Final = 0.1
# Two returns of a ray may be the same point; more never are.
_DISTINCT_SHARE: Final = 0.25
# Range times a sine is a whole number of metres by chance only. Where five columns are read as four, a fifth of the
# coordinates are ring numbers. The six sides of a simulated room may stand at whole metres: the most frequent values
# do not count.
_WHOLE_SHARE: Final = 0.05
_WALLS: Final = 6
_HIGHEST: Final = 65_535  # of a ring or an intensity; float32 beyond a million are whole by themselves
# Rings are ranked by elevation. Where ring numbers mean nothing, half of the steps go down.
_FALLING_SHARE: Final = 0.25
_FALLING_DEG: Final = 0.5
_FEWEST_OF_RING: Final = 10
# The fastest data sheets state 100 Hz (Livox); a driver that sends packets does so 150 times a second and more.
_SHORTEST_S: Final = 1.0 / 120.0
_UNIT_S: Final = 1e-4
# Four layers of a quarter degree give a thousand; a board of half a metre at 5 m has a hundred of any sensor that
# measures one.
_FEWEST_POINTS: Final = 100
_USUAL_M: Final = 7.0
_UNITS: Final = {"centimetres": 100.0, "millimetres": 1000.0}
CODE: Final = "recording_implausible"


@dataclass(slots=True)
class SweepSample:
    """Points of sweeps spread over a recording, at most 16 sweeps of 1000 points each.

    Attributes:
        xyz: (M, 3) float32 of each sampled sweep, metres.
        rings: (M,) uint16 of each.
        counts: number of points of each.
    """

    xyz: list[NDArray[np.float32]] = field(default_factory=list[NDArray[np.float32]])
    rings: list[NDArray[np.uint16]] = field(default_factory=list[NDArray[np.uint16]])
    counts: list[int] = field(default_factory=list[int])
    _step: int = 1
    _read: int = 0

    def add(self, sweep: Sweep) -> None:
        """Take every n-th sweep; n doubles when there are too many."""
        if self._read % self._step == 0:
            some = _runs(len(sweep.xyz))
            self.xyz.append(sweep.xyz[some])
            self.rings.append(sweep.ring[some])
            self.counts.append(len(sweep.xyz))
        self._read += 1
        if len(self.xyz) > _MOST_SWEEPS:
            self._step *= 2
            self.xyz, self.rings, self.counts = self.xyz[::2], self.rings[::2], self.counts[::2]


def _runs(count: int) -> NDArray[np.intp]:
    """Indices of points: runs of neighbours, which show what repeats, spread over a sweep."""
    if count <= _RUNS * _RUN:
        return np.arange(count)
    starts = np.linspace(0, count - _RUN, _RUNS).astype(np.intp)
    return (starts[:, None] + np.arange(_RUN)).reshape(-1)


def implausible(sample: SweepSample, topic: str, step_s: float | None) -> RecordingFault | None:
    """Return the first thing that no LiDAR can have measured, with its likeliest cause; None if nothing is wrong.

    Args:
        sample: of the recording.
        topic: of the LiDAR.
        step_s: from one sweep to the next; None where stamps do not tell.
    """
    if not sample.xyz:
        return None
    xyz = np.concatenate(sample.xyz).astype(np.float64)
    doubts = (
        *(_mapped(xyz), _columns(xyz), _far(xyz), _near(xyz), _flat(xyz), _alike(sample.xyz)),
        *(_order(xyz, np.concatenate(sample.rings)), _few(sample.counts), _fast(step_s)),
    )
    doubt = next((doubt for doubt in doubts if doubt is not None), None)
    if doubt is None:
        return None
    what, remedy = doubt
    more = "If the points are right all the same, say --accept, or accept the points on the recording's page."
    sentence, remedy = f"{topic}: {what}", f"{remedy} {more}"
    return RecordingFault(code=CODE, sensor="lidar", verdict="stop", sentence=sentence, remedy=remedy)


def refusal(fault: RecordingFault) -> ReadError:
    """The fault as the reason to refuse a recording; its field ``can_accept`` says that the owner may overrule it."""
    return ReadError(fault.code, fault.sentence, fault.remedy, {"can_accept": True})


_Doubt = tuple[str, str] | None


def _columns(xyz: NDArray[np.float64]) -> _Doubt:
    is_whole = (xyz == np.rint(xyz)) & (xyz != 0.0) & (np.abs(xyz) <= _HIGHEST)
    counts: NDArray[np.intp] = np.sort(np.unique(xyz[is_whole], return_counts=True)[1])
    whole = np.count_nonzero(is_whole) / xyz.size
    if int(counts[:-_WALLS].sum()) / xyz.size < _WHOLE_SHARE or whole > 0.5:
        return None
    return (
        f"{100 * whole:.0f} % of the coordinates are whole numbers, as rings and intensities are: the columns were "
        "probably counted wrongly (five values a point, or six?).",
        "Write the clouds with names of their columns, as .pcd, .npy or .csv.",
    )


def _mapped(xyz: NDArray[np.float64]) -> _Doubt:
    median_m = float(np.median(np.linalg.norm(xyz, axis=1)))
    around_m = float(np.median(np.linalg.norm(xyz - np.median(xyz, axis=0), axis=1)))
    if median_m <= _FARTHEST_MEDIAN_M or around_m >= min(_FARTHEST_MEDIAN_M, 0.5 * median_m):
        return None
    return (
        f"its points lie {median_m:,.0f} m from the sensor, but {around_m:.0f} m around their middle: coordinates "
        "are probably of a map.",
        "Record the driver's own clouds, in the LiDAR's frame.",
    )


def _far(xyz: NDArray[np.float64]) -> _Doubt:
    range_m: NDArray[np.float64] = np.linalg.norm(xyz, axis=1)
    next_m, median_m = float(np.quantile(range_m, _NEXT_SHARE)), float(np.median(range_m))
    if median_m <= _FARTHEST_MEDIAN_M and next_m <= _NEXT_M:
        return None
    if median_m > _FARTHEST_MISREAD_M:
        what = (
            f"half of its points lie farther than {median_m:.0e} m: their layout or byte order is probably misstated."
        )
        return what, "Look at the program that wrote the clouds."
    unit = min(_UNITS, key=lambda name: abs(math.log(median_m / _UNITS[name] / _USUAL_M)))
    return (
        f"half of its points lie farther than {median_m:,.0f} m: coordinates are probably {unit}.",
        f"Write them in metres (divided by {_UNITS[unit]:.0f}).",
    )


def _near(xyz: NDArray[np.float64]) -> _Doubt:
    range_m: NDArray[np.float64] = np.linalg.norm(xyz, axis=1)
    share, farthest_m = float(np.mean(range_m < _NEAREST_M)), float(np.quantile(range_m, 0.99))
    if share <= _NEAR_SHARE and farthest_m >= _SMALLEST_M:
        return None
    what = f"{100 * share:.0f} % of its points are" if share > _NEAR_SHARE else "all its points are"
    near_m = _NEAREST_M if share > _NEAR_SHARE else _SMALLEST_M
    return (
        f"{what} nearer than {near_m:.1f} m, where no LiDAR sees: x, y and z are probably not metres, or are other "
        "columns.",
        "Write coordinates in metres, and name the columns.",
    )


def _alike(sweeps: list[NDArray[np.float32]]) -> _Doubt:
    shares = [len(np.unique(np.ascontiguousarray(xyz).view("V12"))) / len(xyz) for xyz in sweeps if len(xyz)]
    if float(np.median(shares)) >= _DISTINCT_SHARE:
        return None
    return (
        f"its sweeps repeat the same points: only {100 * float(np.median(shares)):.0f} % are distinct.",
        "Look at the driver, or at the program that wrote the clouds: it may leave its buffer as it was, or write "
        "other columns before x, y and z.",
    )


def _flat(xyz: NDArray[np.float64]) -> _Doubt:
    """Fit a plane to all points, twice more to those nearest to it: a few damaged points turn it."""
    inside, centre, normal = xyz, np.zeros(3), np.zeros(3)
    distance_m = np.zeros(len(xyz))
    for _ in range(3):
        centre = np.median(inside, axis=0)
        scatter: NDArray[np.float64] = (inside - centre).T @ (inside - centre)
        normal = np.linalg.eigh(scatter).eigenvectors[:, 0]
        distance_m = np.abs((xyz - centre) @ normal)
        inside = xyz[distance_m <= np.quantile(distance_m, _FLAT_SHARE)]
    if len(inside) < 3 or float(np.quantile(distance_m, _FLAT_SHARE)) >= _FLAT_M:
        return None
    if float(np.max(np.ptp(inside, axis=0))) < _FLAT_M:  # no plane, but one point
        return None
    if abs(float(normal @ centre)) >= _ORIGIN_M:
        return None
    is_level = abs(float(normal[2])) > np.cos(np.radians(0.5))
    where = f"z is {float(centre[2]):.2f} m in all its points" if is_level else "all its points lie in one plane"
    return (
        f"{where}: the driver has probably no table of the beams' elevations, or the sensor scans one plane.",
        "Give the driver the sensor's own calibration or metadata, and record again; or record a LiDAR of several "
        "rings.",
    )


def _order(xyz: NDArray[np.float64], ring: NDArray[np.uint16]) -> _Doubt:
    elevation_deg = np.degrees(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))
    order = np.argsort(ring, kind="stable")
    starts = np.flatnonzero(np.diff(ring[order], prepend=-1))
    parts = [part for part in np.split(elevation_deg[order], starts[1:]) if len(part) >= _FEWEST_OF_RING]
    steps = np.diff([float(np.median(part)) for part in parts])
    if len(steps) < 4 or float(np.mean(steps < -_FALLING_DEG)) <= _FALLING_SHARE:
        return None
    return (
        f"ring numbers do not follow elevation: {int(np.count_nonzero(steps < -_FALLING_DEG))} of {len(steps)} steps "
        "from ring to ring go down.",
        "Record the driver's own ring field, or leave the field out so that rings are computed.",
    )


def _few(counts: list[int]) -> _Doubt:
    usual = float(np.median(counts))
    if usual >= _FEWEST_POINTS:
        return None
    return (
        f"a usual sweep has {usual:.0f} points: it is perhaps of a radar, or a part of the cloud.",
        "Record all points of the LiDAR.",
    )


def _fast(step_s: float | None) -> _Doubt:
    if step_s is None or step_s >= _SHORTEST_S:
        return None
    if step_s < _UNIT_S:
        what = f"its stamps are {1e9 * step_s:,.0f} ns apart: they are probably in another unit."
        return what, "Write stamps in nanoseconds since 1970."
    return (
        f"it has {1 / step_s:.0f} clouds a second: each holds a part of a turn.",
        "Let the driver send whole turns, or record its packets.",
    )
