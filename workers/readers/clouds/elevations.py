"""The elevations at which a LiDAR's rings lie, found from points alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

_BIN_DEG: Final = 0.005
_TOLERANCE: Final = 0.4
_MAX_LEVELS: Final = 256
_WEAK_ROUNDS: Final = 4
_WEAK_POINTS: Final = 4
_WEAK_VALLEY: Final = 0.05
# Half widths of smoothing in bins, and the height of a valley in units of the usual tooth: the finest that fits wins.
_SCALES: Final = tuple((half, valley) for half in (1, 3, 8, 20) for valley in (0.02, 0.1))


@dataclass(frozen=True, slots=True)
class Levels:
    """Elevations of rings.

    Attributes:
        centres: (M,) float64 degrees, ascending.
        spread_deg: degrees from the 5th to the 95th percentile of a ring's points, the widest ring's.
        gap_deg: degrees between neighbours, the smallest; infinite for a single ring.
        between: share of the points that lie between rings.
    """

    centres: NDArray[np.float64]
    spread_deg: float
    gap_deg: float
    between: float

    @property
    def separated(self) -> bool:
        """Whether every ring is far narrower than the gap beside it, and hardly a point lies between rings."""
        if len(self.centres) < 2:
            return False
        typical = float(np.median(np.diff(self.centres)))
        return self.gap_deg > 2 * self.spread_deg and self.gap_deg > 0.3 * typical and self.between < 0.03


def elevations(xyz: NDArray[np.floating], focus_m: float = 0.0) -> NDArray[np.float64]:
    """(N,) float64 degrees above the horizontal of (N, 3) points in the LiDAR's frame.

    Args:
        xyz: metres.
        focus_m: distance from the sensor's axis, in the direction of the shot, of the point that all beams pass.
    """
    x, y, z = (xyz[:, axis].astype(np.float64) for axis in range(3))
    return np.degrees(np.arctan2(z, np.maximum(np.hypot(x, y) - focus_m, 1e-3)))


def sample(xyz: NDArray[np.floating], most: int) -> NDArray[np.floating]:
    """At most ``most`` of the points (N, 3), without a pattern: every k-th point of a file that lists firing after
    firing is of a few rings alone. The same points each time."""
    return xyz if len(xyz) <= most else xyz[np.sort(np.random.default_rng(0).permutation(len(xyz))[:most])]


def find_focus(xyz: NDArray[np.floating]) -> float:
    """Metres from the axis to the point that all beams pass: 0.041 for a VLP-16, 0.016 for an OS1, often 0.

    Seen from there every beam keeps its elevation at all distances, so the histogram of elevations is sharpest:
    its entropy is smallest.
    """
    near = sample(xyz, 20_000)

    def blur(focus_m: float) -> float:
        share = np.histogram(elevations(near, focus_m), 6000, (-60, 60))[0] / max(1, len(near))
        share = share[share > 0]
        return float(-(share * np.log(share)).sum())

    middle = min(np.arange(-0.03, 0.091, 0.003).tolist(), key=blur)
    return min((middle + np.arange(-0.003, 0.0031, 0.0003)).tolist(), key=blur)


def nearest_level(elevation: NDArray[np.float64], centres: NDArray[np.float64]) -> NDArray[np.int32]:
    """(N,) int32 index of the ring of each elevation, -1 where it lies between two rings or beyond the last ones.

    Args:
        elevation: (N,) degrees.
        centres: (M,) ascending degrees; a point belongs to a ring within 0.4 of the gap to its neighbour.
    """
    if not len(centres):
        return np.full(len(elevation), -1, np.int32)
    gaps = np.diff(centres) if len(centres) > 1 else np.array([1.0])
    below = centres - _TOLERANCE * np.r_[gaps[0], gaps]
    above = centres + _TOLERANCE * np.r_[gaps, gaps[-1]]
    index = np.searchsorted(below, elevation, side="right") - 1
    is_near = (index >= 0) & (elevation <= above[np.maximum(index, 0)])
    return np.where(is_near, index, -1).astype(np.int32)


def find_levels(elevation: NDArray[np.float64]) -> Levels:
    """Find the elevations around which points crowd.

    Points of one ring share an elevation, so a histogram is a comb. Its teeth are told apart at the finest scale that
    gives narrow teeth with wide gaps; where none does, what comes nearest is answered, for a message.

    Args:
        elevation: (N,) degrees of the points of several sweeps.
    """
    nearest = Levels(np.zeros(0), 0.0, float("inf"), 1.0)
    if not len(elevation):
        return nearest
    counts = _histogram(elevation)
    for half, valley in _SCALES:
        centres = _teeth(counts, half, valley)
        if not 1 < len(centres) <= _MAX_LEVELS:
            continue
        levels = _with_weak(elevation, measure_levels(elevation, centres), half)
        if levels.separated:
            return levels
        if len(nearest.centres) < 2 or levels.between < nearest.between:
            nearest = levels
    return nearest


def _with_weak(elevation: NDArray[np.float64], levels: Levels, half: int) -> Levels:
    """Add the rings of few points: rings that see mostly sky are lost beside a hundred times as many points."""
    for _ in range(_WEAK_ROUNDS):
        left = elevation[nearest_level(elevation, levels.centres) < 0]
        weak = _teeth(_histogram(left), half, _WEAK_VALLEY)
        typical = float(np.median(np.diff(levels.centres)))
        alone = [
            centre
            for centre in weak.tolist()
            if np.abs(levels.centres - centre).min() > 0.7 * typical
            and np.count_nonzero(np.abs(left - centre) < 0.2 * typical) >= _WEAK_POINTS
        ]
        more = np.union1d(levels.centres, np.array(alone))
        if not alone or len(more) > _MAX_LEVELS:
            break
        wider = measure_levels(elevation, more)
        if wider.gap_deg < 0.3 * typical or wider.between > levels.between:
            break
        levels = wider
    return levels


def measure_levels(elevation: NDArray[np.float64], centres: NDArray[np.float64]) -> Levels:
    """Measure how well (M,) ascending rough centres (degrees) fit (N,) elevations; they become the rings' medians."""
    index = nearest_level(elevation, centres)
    order = np.argsort(index, kind="stable")
    levels, starts = np.unique(index[order], return_index=True)
    parts = np.split(elevation[order], starts[1:])
    settled, spread = centres.copy(), 0.0
    for level, part in zip(levels.tolist(), parts, strict=True):
        if level >= 0:
            low, middle, high = np.percentile(part, [5, 50, 95])
            settled[level], spread = middle, max(spread, float(high - low))
    gap = float(np.diff(settled).min()) if len(settled) > 1 else float("inf")
    return Levels(settled, spread, gap, float(np.mean(index < 0)))


def _histogram(elevation: NDArray[np.float64]) -> NDArray[np.float64]:
    bins = np.clip(((elevation + 90) / _BIN_DEG).astype(np.int64), 0, round(180 / _BIN_DEG))
    return np.bincount(bins, minlength=round(180 / _BIN_DEG) + 1).astype(np.float64)


def _teeth(counts: NDArray[np.float64], half: int, valley: float) -> NDArray[np.float64]:
    """(M,) centres in degrees of the runs of bins above a share of the usual tooth's height.

    Args:
        counts: points per bin.
        half: half width in bins of the smoothing.
        valley: the share.
    """
    kernel: NDArray[np.float64] = np.hanning(2 * half + 3)[1:-1]
    density: NDArray[np.float64] = np.convolve(counts, kernel / kernel.sum(), "same").astype(np.float64)
    tops = np.flatnonzero((density[1:-1] > density[:-2]) & (density[1:-1] >= density[2:])) + 1
    if not len(tops):
        return np.zeros(0)
    heights = np.sort(density[tops])[::-1]
    # The usual tooth is the median of those that together hold nine tenths of the height: noise is left out.
    total: NDArray[np.float64] = np.cumsum(heights)
    strong = heights[: int(np.searchsorted(total, 0.9 * float(total[-1]))) + 1]
    on = np.zeros(len(density) + 2, np.bool_)
    on[1:-1] = density > valley * float(np.median(strong))
    edges: NDArray[np.intp] = np.flatnonzero(on[1:] != on[:-1])
    runs = edges.reshape(-1, 2)
    tooth = np.repeat(np.arange(len(runs)), runs[:, 1] - runs[:, 0])
    bins = np.flatnonzero(on[1:-1])
    middles = np.bincount(tooth, density[bins] * bins) / np.bincount(tooth, density[bins])
    return (middles + 0.5) * _BIN_DEG - 90
