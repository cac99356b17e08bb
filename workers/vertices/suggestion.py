"""A region of interest suggested from what moves against the still background of a recording.

Sweeps spread over the recording tell which places stand still (`occupancy`). What moves before them is clustered on
the ground; clusters of a person's size that stay together from one sweep to the next tell where the person walked.
The suggestion is a polygon around that, off the ground, without the posts that stand inside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.geometry.errors import InputError
from workers.vertices.footprint import area_around, area_m2, clusters
from workers.vertices.occupancy import Occupancy
from workers.vertices.region import Region
from workers.vertices.sweep_source import SweepSource

Floats = NDArray[np.float64]
Document = dict[str, Any]

_FEWEST: Final = 8
_CELL_M: Final = 0.4
_WIDEST_M: Final = 2.2  # a person with a board, and what the grid adds
_TALLEST_M: Final = 2.8
_POINTS_AT_1_M: Final = 100.0  # a person-sized thing has more points than this over its distance
_FEWEST_POINTS: Final = 4
_BESIDE_M: Final = 1.2
_TOGETHER_S: Final = 0.5  # sweeps this near in time see a walker in nearly the same place
_FASTEST_M_S: Final = 3.0
_MARGIN_M: Final = 0.5
_OFF_GROUND_M: Final = 0.12
_ABOVE_M: Final = 0.3
_REACH_M: Final = 2.8  # a board held up
_KEPT: Final = 24  # sweeps whose points are kept in memory
_POST_M: Final = 1.5
_MOST_POSTS: Final = 16


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A region document (see `region_document`), and what it rests on (apexcal.documents.studies.SuggestionFacts)."""

    document: Document
    facts: Document


@dataclass(frozen=True, slots=True, eq=False)
class _Thing:
    """A cluster of person's size that moves: its points (N, 3), and the middle of them on the ground (2,)."""

    points: Floats
    middle: Floats


@dataclass(slots=True)
class _Seen:
    """What the second reading gathers: by sweep what moves, of some sweeps all points and those that stand still."""

    points: int = 0
    still: int = 0
    things: list[list[_Thing]] = field(default_factory=list[list[_Thing]])
    clouds: dict[int, NDArray[np.float32]] = field(default_factory=dict[int, NDArray[np.float32]])
    background: list[Floats] = field(default_factory=list[Floats])


def suggest(source: SweepSource, *, samples: int = 360, on_sweep: Callable[[int], None] | None = None) -> Suggestion:
    """The region that the moving person and board walked through, with a margin, off the ground.

    Args:
        source: the sweeps of a recording whose LiDAR stands still.
        samples: how many sweeps to look at, spread over the recording.
        on_sweep: called with the number of sweeps read so far; it may raise to stop the work.

    Raises:
        InputError: ``too_few_sweeps``, ``nothing_moves``, ``everything_moves``.
    """
    if len(source) < _FEWEST:
        raise InputError(
            "too_few_sweeps",
            f"The recording has {len(source)} sweeps; what moves shows in {_FEWEST} at least.",
            "Write the region by hand.",
        )
    chosen = _spread(len(source), samples)
    occupancy = Occupancy()
    stamps_ns: list[int] = []
    for done, index in enumerate(chosen, start=1):
        sweep = source.sweep(index)
        occupancy.add(sweep)
        stamps_ns.append(sweep.stamp_ns)
        if on_sweep is not None:
            on_sweep(done)
    seen = _look(source, chosen, occupancy, on_sweep)
    if seen.still < 0.4 * seen.points:
        raise InputError(
            "everything_moves",
            f"Only {seen.still / max(seen.points, 1):.0%} of the points stand still: the LiDAR itself moves, or each "
            "sweep shows another place.",
            "Record with the vehicle at rest, or write the region by hand.",
        )
    things = _walker(seen.things, stamps_ns)
    if not any(things):
        raise InputError(
            "nothing_moves",
            "Nothing of a person's size moves in the recording.",
            "Walk through the whole field with the board while recording, or write the region by hand.",
        )
    # Between two sweeps that were looked at the person walked a little farther.
    between_s = (max(stamps_ns) - min(stamps_ns)) * 1e-9 / max(len(chosen) // 2, 1)
    return _describe(things, seen, _MARGIN_M + min(2.0, 0.25 * between_s))


def _look(
    source: SweepSource, chosen: list[int], occupancy: Occupancy, on_sweep: Callable[[int], None] | None
) -> _Seen:
    """Read the sweeps again, now that it is known what stands still; all of them at once may not fit in memory."""
    seen = _Seen()
    for number, index in enumerate(chosen):
        sweep = source.sweep(index)
        moving, still = occupancy.moving(sweep)
        seen.points += len(sweep.xyz)
        seen.still += int(np.count_nonzero(still))
        seen.things.append(_things(sweep.xyz[moving].astype(np.float64)))
        if number % max(1, len(chosen) // _KEPT) == 0:
            seen.clouds[number] = sweep.xyz
            seen.background.append(sweep.xyz[still].astype(np.float64))
        if on_sweep is not None:
            on_sweep(len(chosen))
    return seen


def _spread(count: int, samples: int) -> list[int]:
    """Numbers of sweeps spread over the recording, in neighbouring pairs, so that things can be met twice."""
    if count <= samples:
        return list(range(count))
    first = np.linspace(0, count - 2, max(samples // 2, _FEWEST)).round().astype(int)
    return sorted({*first.tolist(), *(first + 1).tolist()})


def _walker(things: list[list[_Thing]], stamps_ns: list[int]) -> list[list[_Thing]]:
    """For each sweep what moves and has a person's size; with a neighbour near in time, only what is there too."""
    met: list[dict[int, _Thing]] = [{} for _ in things]
    alone = [True] * len(things)
    for before, after in pairwise(range(len(things))):
        apart_s = abs(stamps_ns[after] - stamps_ns[before]) * 1e-9
        if apart_s > _TOGETHER_S:
            continue
        alone[before] = alone[after] = False
        for one in things[before]:
            for other in things[after]:
                if np.hypot(*(one.middle - other.middle)) <= 0.5 + _FASTEST_M_S * apart_s:
                    met[before][id(one)] = one
                    met[after][id(other)] = other
    return [_largest(things[i] if alone[i] else list(met[i].values())) for i in range(len(things))]


def _largest(things: list[_Thing]) -> list[_Thing]:
    """The thing with the largest face, and what belongs to it: a board adds to a person's."""
    if not things:
        return []
    # As many points as a face has, seen from one metre.
    largest = max(things, key=lambda thing: len(thing.points) * float(thing.middle @ thing.middle))
    return [thing for thing in things if np.hypot(*(thing.middle - largest.middle)) <= _BESIDE_M]


def _things(xyz: Floats) -> list[_Thing]:
    if not len(xyz):
        return []
    cluster = clusters(xyz[:, :2], _CELL_M)
    found: list[_Thing] = []
    for number in np.flatnonzero(np.bincount(cluster) >= _FEWEST_POINTS):
        points = xyz[cluster == number]
        size = np.ptp(points, axis=0)
        middle = points[:, :2].mean(axis=0)
        enough = len(points) >= _POINTS_AT_1_M / max(float(np.hypot(*middle)), 1.0)
        if enough and np.hypot(size[0], size[1]) <= _WIDEST_M and size[2] <= _TALLEST_M:
            found.append(_Thing(points, middle))
    return found


def _describe(things: list[list[_Thing]], seen: _Seen, margin_m: float) -> Suggestion:
    points = np.concatenate([thing.points for some in things for thing in some])
    corners = area_around(points[:, :2], margin_m)
    still = np.concatenate(seen.background)
    inside = still[Region.from_document({"polygon": corners.tolist()}).mask(still)]
    notes: list[str] = []
    ground, z_low = _ground(points, inside, notes)
    # A sensor of few rings may never have met the board where it was highest.
    z_high = max(float(np.max(points[:, 2])) + _ABOVE_M, ground + _REACH_M)
    posts = _posts(inside[(inside[:, 2] > z_low) & (inside[:, 2] < z_high)], notes)
    document: Document = {
        "polygon": [[round(x, 2), round(y, 2)] for x, y in corners.tolist()],
        "z": [round(z_low, 2), round(z_high, 2)],
    }
    if posts:
        cut = [
            {"not": {"box": {"min": [*low, document["z"][0]], "max": [*high, document["z"][1]]}}}
            for low, high in posts
        ]
        document = {"and": [document, *cut]}
    region = Region.from_document(document)
    kept = [int(np.count_nonzero(region.mask(xyz))) for number, xyz in seen.clouds.items() if things[number]]
    facts: Document = {
        "sweeps_read": len(things),
        "sweeps_moving": sum(bool(some) for some in things),
        "points_per_sweep": float(np.median(kept)) if kept else 0.0,
        "area_m2": round(area_m2(corners), 1),
        "ground_z": round(ground, 2),
        "z_low": round(z_low, 2),
        "z_high": round(z_high, 2),
        "posts": len(posts),
        "notes": notes,
    }
    return Suggestion(document, facts)


def _ground(points: Floats, still: Floats, notes: list[str]) -> tuple[float, float]:
    """Height of the ground where the person walked, and that from which on the region keeps points."""
    feet = float(np.percentile(points[:, 2], 2.0))
    floor = still[still[:, 2] < feet + 0.3, 2]
    if len(floor) < 50:
        notes.append("The ground is hardly seen there; its height was taken from the lowest points that move.")
        return feet, feet + _OFF_GROUND_M
    middle, high = np.percentile(floor, (50.0, 99.0)).tolist()
    if high > middle + 0.35:
        notes.append(
            f"The ground rises by {high - middle:.1f} m above its middle height there; where it does, its points "
            "stay in the region. Cut them off by hand."
        )
        high = middle
    return middle, high + _OFF_GROUND_M


def _posts(still: Floats, notes: list[str]) -> list[tuple[list[float], list[float]]]:
    """Lower and upper corner (x, y) of boxes around small things that stand still; more than they are is left in."""
    boxes: list[tuple[list[float], list[float]]] = []
    left = 0
    if len(still):
        cluster = clusters(still[:, :2], 0.25)
        for number in np.flatnonzero(np.bincount(cluster) >= _KEPT // 2):
            xy = still[cluster == number, :2]
            if np.ptp(xy, axis=0).max() > _POST_M or len(boxes) == _MOST_POSTS:
                left += 1
                continue
            low, high = xy.min(axis=0) - 0.1, xy.max(axis=0) + 0.1
            boxes.append((low.round(2).tolist(), high.round(2).tolist()))
    if boxes:
        notes.append(f"{len(boxes)} small things that stand still inside were cut out.")
    if left:
        notes.append(
            f"{left} larger things that stand still reach into the region; their points stay in it. Narrow it by "
            "hand."
        )
    return boxes
