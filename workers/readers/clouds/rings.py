"""Rings numbered by elevation, 0 the lowest: from a sensor's own laser ids, or computed where the file has none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.clouds.elevations import elevations, find_focus, find_levels, nearest_level, sample
from workers.readers.clouds.ring_runs import LINE_COUNTS, RunOrder, learn_runs
from workers.readers.clouds.ring_spread import RINGLESS
from workers.readers.recording import ReadError

# A file whose highest lasers see only sky still counts from the right end by LINE_COUNTS.
_ENOUGH_POINTS: Final = 20
_CLEAR_STEP_DEG: Final = 0.1
# Damaged points carry ring ids at random. A sensor's own uppermost rings may see little, but lie among the others.
_MOST_RINGS: Final = LINE_COUNTS[-1]
_NO_ID: Final = -(2**40)
_HARDLY_ANY: Final = 3
_HARDLY_ANY_PART: Final = 0.01
_FEWEST_STEADY: Final = 4  # rings, and sweeps, from which a rule can be told
_LEAST_FILLED: Final = 0.75
# Elevations in degrees as the makers' manuals give them; a sensor whose top rings see only sky is told by the others.
_VLP32C: Final = (
    *(-25.0, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333, -3.0, -2.667, -2.333),
    *(-2.0, -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667, 1.0, 1.333, 1.667, 2.333, 3.333, 4.667, 7.0),
    *(10.333, 15.0),
)
_KNOWN: Final[tuple[tuple[str, NDArray[np.float64]], ...]] = (
    ("a VLP-16", np.linspace(-15, 15, 16)),
    ("an HDL-32E", np.linspace(-92 / 3, 32 / 3, 32)),
    ("a VLP-32C", np.array(_VLP32C)),
)
_MATCH_DEG: Final = 0.15
_LARGEST_HOLE: Final = 4
_MANY: Final = 150_000


@dataclass(frozen=True, slots=True)
class RingOrder:
    """The file's ring ids to numbers by elevation.

    Attributes:
        table: (largest id + 1,) int32, number of each id, -1 for an id that is not known.
        count: number of rings; numbers are 0 to count - 1.
        note: a sentence where the numbers differ from the file's, else empty.
        first: the id of the table's first number: 0, or the lowest of ids below 0.
    """

    table: NDArray[np.int32]
    count: int
    note: str
    first: int = 0

    def number(self, ids: NDArray[np.generic]) -> NDArray[np.int32]:
        """(N,) int32 numbers of (N,) ids, -1 where an id is not known."""
        index = ring_ids(ids) - self.first
        in_table = (index >= 0) & (index < len(self.table))
        if in_table.all():
            return self.table[index]
        return np.where(in_table, self.table[np.where(in_table, index, 0)], np.int32(-1))


def ring_ids(values: NDArray[np.generic]) -> NDArray[np.int64]:
    """(N,) ids as integers, :data:`_NO_ID` for values that are none: damaged files have NaN and 1e30 among floats."""
    if values.dtype.kind != "f":
        return values.astype(np.int64)
    numbers = values.astype(np.float64)
    return np.where(np.abs(numbers) < 2.0**31, numbers, _NO_ID).astype(np.int64)


def learn_rings(clouds: Sequence[tuple[NDArray[np.float32], NDArray[np.int64]]], where: str) -> RingOrder:
    """The order of the rings from sample clouds.

    Ids count by what is there: 0, 4 ... 60 are 16 rings, as 1 to 16 are. Then those that ascend with elevation keep
    their order, so that an empty ring leaves its gap; those that descend (Ouster counts from the top) are turned
    round; others (a VLP-16's laser ids) are ranked by median elevation. Ids far from the others that rest on hardly
    any points are damage and stay unknown.

    Args:
        clouds: pairs of (N, 3) float32 points in the LiDAR's frame and (N,) int64 ids.
        where: names the LiDAR in messages.

    Raises:
        ReadError: ``rings_too_many`` where more ids than any sensor has rest on more than damage.
    """
    ids, elevation, counts = _median_elevations(clouds)
    is_strong = counts >= max(_HARDLY_ANY, _HARDLY_ANY_PART * int(counts.max(initial=0)))
    below = ids[is_strong & (ids < 0)]
    first = int(below[0]) if len(below) > 1 else 0  # -1 alone marks points of no ring
    ids = ids - first
    strong = ids[is_strong]
    counted = _counted(strong, ids[~is_strong], [np.unique(ring) - first for _, ring in clouds if len(ring)])
    if len(strong) and strong[-1] > counted[-1]:
        raise ReadError(
            "rings_too_many",
            f"{where} has ring ids up to {strong[-1] + first}; sensors have at most {_MOST_RINGS} rings.",
            "Record the driver's own ring field, or leave the field out so that rings are computed from the points. "
            "If the file may be damaged, copy it again.",
        )
    places = np.minimum(np.searchsorted(counted, ids), len(counted) - 1)
    places = np.where(counted[places] == ids, places, -1)
    lines, is_sound = _without_damage(places, counts)
    enough = (counts >= min(_ENOUGH_POINTS, int(counts.max(initial=1))))[is_sound]
    numbers, note = _numbered(places[is_sound], elevation[is_sound], enough, min(lines, len(counted)))
    named = counted[: len(numbers)]
    if not note and (named[-1] >= len(named) or first):
        some = ", ".join(map(str, (named[:3] + first).tolist()))
        note = f"ring ids {some} ... {named[-1] + first} were counted as {len(named)} rings."
    table = np.full(int(named.max(initial=-1)) + 1, -1, np.int32)
    table[named] = numbers
    return RingOrder(table, int(numbers.max(initial=-1)) + 1, note, first)


def _numbered(
    places: NDArray[np.int64], elevation: NDArray[np.float64], enough: NDArray[np.bool_], lines: int
) -> tuple[NDArray[np.int32], str]:
    """The number of each place, -1 for one that is no ring, and a sentence where they differ."""
    identity = np.arange(lines, dtype=np.int32)
    trusted = elevation[enough] if np.count_nonzero(enough) > 1 else elevation
    steps = np.diff(elevation[enough])
    rises = len(places) == 0 or trusted[-1] >= trusted[0]
    if rises and (steps > -_CLEAR_STEP_DEG).all():
        return identity, ""
    if not rises and (steps < _CLEAR_STEP_DEG).all():
        return identity[::-1].copy(), f"ring ids count from the top; they were turned round (0 to {lines - 1})."
    numbers = np.full(int(places[-1]) + 1, -1, np.int32)
    numbers[places[np.argsort(elevation, kind="stable")]] = np.arange(len(places), dtype=np.int32)
    return numbers, "ring ids do not follow elevation; rings were renumbered, 0 the lowest."


def _counted(
    strong: NDArray[np.int64], weak: NDArray[np.int64], sweeps: Sequence[NDArray[np.int64]]
) -> NDArray[np.int64]:
    """Return the ascending ids that count as a ring each: 0 to 255, unless the file counts otherwise.

    Equal steps between ids are steps of one ring. The count begins at the lowest id if the ids are then as many as
    some sensor has and no lower id has a point, and at 0 if not, for the lowest rings may see nothing. Both ask that
    sweeps have the same ids: in a cropped cloud rings come and go. If they do, what is missing here and there is no
    ring either.

    Args:
        strong: ascending ids on which more than damage rests.
        weak: ascending ids on which hardly any points rest.
        sweeps: ids of each sweep.
    """
    if len(strong) < _FEWEST_STEADY:
        return np.arange(_MOST_RINGS)
    present = np.sum([np.isin(strong, ids) for ids in sweeps], axis=0, dtype=np.float64) / len(sweeps)
    if float(np.mean(present > 0.999)) < 0.5:
        return np.arange(_MOST_RINGS)
    step, start = int(np.gcd.reduce(np.diff(strong))), int(strong[0])
    span = (int(strong[-1]) - start) // step + 1
    if len(sweeps) >= _FEWEST_STEADY and float(np.mean(present)) > 0.9 and len(strong) < _LEAST_FILLED * span:
        return strong[:_MOST_RINGS]
    is_lowest = not bool(((weak < start) & ((start - weak) % step == 0)).any())
    is_whole = is_lowest and span == len(strong) and span in LINE_COUNTS
    return (start if is_whole or start >= _MOST_RINGS * step else start % step) + step * np.arange(_MOST_RINGS)


def _median_elevations(
    clouds: Sequence[tuple[NDArray[np.float32], NDArray[np.int64]]],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.intp]]:
    """Ids of rings, ascending; median elevation of each in degrees; on how many points it rests."""
    xyz = np.concatenate([np.zeros((0, 3)), *(xyz.astype(np.float64) for xyz, _ in clouds)])
    ring = np.concatenate([np.zeros(0, np.int64), *(ring for _, ring in clouds)])
    usable = np.abs(ring) < 65536
    xyz, ring = xyz[usable], ring[usable]
    elevation = np.degrees(np.arctan2(xyz[:, 2], np.hypot(xyz[:, 0], xyz[:, 1])))
    order = np.argsort(ring, kind="stable")
    ids, starts, counts = np.unique(ring[order], return_index=True, return_counts=True)
    parts = np.split(elevation[order], starts[1:]) if len(ids) else []
    return ids, np.array([np.median(part) for part in parts], np.float64), counts


def _without_damage(places: NDArray[np.int64], counts: NDArray[np.intp]) -> tuple[int, NDArray[np.bool_]]:
    """The sensor's number of lines, and which places are rings: not those beyond that rest on hardly any points."""
    most = int(counts.max(initial=0))
    few = np.where(places < _MOST_RINGS, _HARDLY_ANY, max(_HARDLY_ANY, _HARDLY_ANY_PART * most))
    solid = (counts >= few) if most >= _ENOUGH_POINTS else np.ones(len(places), np.bool_)
    solid &= places >= 0
    highest = int(places[solid].max(initial=0))
    lines = next((n for n in LINE_COUNTS if n > highest), highest + 1)
    return lines, solid | ((places >= 0) & (places < lines))


@dataclass(frozen=True, slots=True)
class ComputedRings:
    """Rings by elevation, or by the order of points in the file.

    Attributes:
        centres: (M,) float64 degrees, ascending, one per ring.
        focus_m: distance from the sensor's axis of the point from which these elevations are seen.
        runs: how rings follow each other in the file, where elevations do not tell them apart.
        count: number of rings; numbers are 0 to count - 1.
        note: a sentence that says how the rings were found.
    """

    centres: NDArray[np.float64]
    focus_m: float
    count: int
    note: str
    runs: RunOrder | None = None

    def number(self, xyz: NDArray[np.float32]) -> NDArray[np.int32]:
        """(N,) int32 ring of (N, 3) points of one sweep in the order of their file, -1 between rings."""
        if self.count == 1:
            return np.zeros(len(xyz), np.int32)
        if self.runs is not None:
            return self.runs.number(xyz)
        return nearest_level(elevations(xyz, self.focus_m), self.centres)


def learn_missing_rings(
    clouds: Sequence[NDArray[np.float32]], where: str, expected: int | None = None
) -> ComputedRings:
    """The rings of a LiDAR whose file has no ring field.

    Args:
        clouds: (N, 3) float32 points of several sweeps, metres, in the LiDAR's own frame, returns only, in the order
            of their file.
        where: names the LiDAR in messages.
        expected: number of rings, if the owner knows it; 1 says that there are none, and all points are of ring 0.

    Raises:
        ReadError: ``rings_not_separable`` where the points' elevations do not fall into separate rings;
            ``rings_unexpected`` where they fall into more than ``expected``.
    """
    if expected == 1:
        return ComputedRings(np.zeros(1), 0.0, 1, f"it has no rings. {RINGLESS}")
    xyz = np.concatenate([np.zeros((0, 3), np.float32), *clouds])
    xyz = sample(xyz, _MANY)
    focus_m, levels = 0.0, find_levels(elevations(xyz))
    if len(xyz):
        # Rings may separate although near points already stray; then they are sharper as seen from the focus.
        sharper_m = find_focus(xyz)
        sharper = find_levels(elevations(xyz, sharper_m))
        if sharper.separated and (not levels.separated or sharper.spread_deg < 0.7 * levels.spread_deg):
            focus_m, levels = sharper_m, sharper
    if not levels.separated:
        runs = learn_runs(clouds, expected)
        if runs is not None:
            return _by_order(runs)
        raise _not_separable(where, len(levels.centres), levels.gap_deg, levels.spread_deg, levels.between)
    centres, how = _complete(levels.centres, elevations(xyz, focus_m))
    if expected is not None and len(centres) > expected:
        raise ReadError(
            "rings_unexpected",
            f"{where} has no ring field, and its points lie at {len(centres)} elevations; {expected} were given.",
            f"Give the sensor's real number of rings, or leave it out to take the {len(centres)} that were found.",
        )
    if expected is not None and len(centres) < expected:
        how += f"; {expected} were expected, and those not seen are taken to lie above"
    return ComputedRings(
        centres,
        focus_m,
        max(len(centres), expected or 0),
        f"the file states no rings; {len(centres)} were computed from the points' elevations "
        f"({centres[0]:.2f} to {centres[-1]:.2f} degrees{how}).",
    )


def _by_order(runs: RunOrder) -> ComputedRings:
    centres = np.sort(runs.typical)
    return ComputedRings(
        centres,
        0.0,
        len(centres),
        f"the file states no rings; the order of its points, ring after ring, tells {len(centres)}.",
        runs,
    )


def _complete(centres: NDArray[np.float64], elevation: NDArray[np.float64]) -> tuple[NDArray[np.float64], str]:
    """Rings of few points or none put in where the sensor is known, or where the others stand on an even grid."""
    for name, nominal in _KNOWN:
        index = np.abs(nominal[:, None] - centres).argmin(0)
        fits = np.abs(nominal[index] - centres).max() < min(_MATCH_DEG, 0.4 * float(np.diff(nominal).min()))
        if fits and len(np.unique(index)) == len(centres) > 0.6 * (index.max() - index.min() + 1):
            return nominal, f", those of {name}"
    gaps = np.diff(centres)
    step = float(np.median(gaps))
    holes = np.rint(gaps / step).astype(int)
    if holes.min() < 1 or holes.max() > _LARGEST_HOLE:
        return centres, ""
    if np.abs(gaps - holes * step).max() > 0.15 * step:
        return centres, ""
    places = np.concatenate([[0], np.cumsum(holes)])
    filled: NDArray[np.float64] = np.interp(np.arange(int(places[-1]) + 1), places, centres)
    below = _further(filled[0] - elevation, step)
    above = _further(elevation - filled[-1], step)
    low = filled[0] - step * np.arange(below, 0, -1)
    high = filled[-1] + step * np.arange(1, above + 1)
    whole = np.concatenate([low, filled, high])
    added = len(whole) - len(centres)
    return whole, f"; {added} with few points or none were added on the even grid of the others" if added else ""


def _further(beyond: NDArray[np.float64], step: float) -> int:
    """Return how many more rings of an even grid the points beyond its end need; 0 if they lie beside the grid."""
    rest = beyond[beyond > 0.5 * step] / step
    on_grid = np.abs(rest - np.rint(rest)) < 0.2
    return int(np.rint(rest[on_grid]).max()) if len(rest) and np.mean(on_grid) > 0.9 and rest.max() < 30 else 0


def _not_separable(where: str, count: int, gap_deg: float, spread_deg: float, between: float) -> ReadError:
    measured = (
        f"at best they crowd at {count} elevations, with gaps down to {gap_deg:.3f} degrees, spreads up to "
        f"{spread_deg:.3f} degrees, and {100 * between:.0f} % of the points between them"
        if count > 1
        else "the points' elevations do not crowd anywhere"
    )
    return ReadError(
        "rings_not_separable",
        f"{where} has no ring field, and its rings cannot be told by elevation: {measured}.",
        "Record the driver's full point type (for a Velodyne: PointXYZIR), or clouds in the LiDAR's own frame, "
        f"neither moved into the vehicle's frame nor corrected for motion. {RINGLESS}",
    )
