"""A suggested region: a polygon around what was seen to move, off the ground, without the posts inside.

Shapes on the ground are clusters of points seen from above, and the convex area around them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from workers.vertices.region import Region

SIDES: Final = 20  # of the areas that are suggested


def clusters(xy: Floats, cell_m: float) -> NDArray[np.int64]:
    """(N,) the cluster of each point (N, 2), numbered from 0: cells of ``cell_m`` that touch, corners included."""
    cells, of_point = np.unique(np.floor(xy / cell_m).astype(np.int64), axis=0, return_inverse=True)
    number = {(int(x), int(y)): i for i, (x, y) in enumerate(cells)}
    cluster = np.full(len(cells), -1, np.int64)
    count = 0
    for first in range(len(cells)):
        if cluster[first] >= 0:
            continue
        cluster[first] = count
        waiting = [first]
        while waiting:
            x, y = cells[waiting.pop()].tolist()
            for dx in (-1, 0, 1):
                for dy in (-1, 0, 1):
                    other = number.get((x + dx, y + dy), -1)
                    if other >= 0 and cluster[other] < 0:
                        cluster[other] = count
                        waiting.append(other)
        count += 1
    return cluster[of_point.reshape(-1)]


def area_around(xy: Floats, margin_m: float) -> Floats:
    """Corners (SIDES, 2), counter-clockwise, of a convex polygon that holds points (N, 2) and ``margin_m`` around.

    Its sides have fixed directions; each lies the margin outside of the farthest point in its direction.
    """
    angle = np.arange(SIDES) * (2.0 * np.pi / SIDES)
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    reach = (xy @ normal.T).max(axis=0) + margin_m
    following = np.roll(normal, -1, axis=0)
    # Each corner lies on two sides: normal . corner = reach.
    corners = np.linalg.solve(
        np.stack([normal, following], axis=1), np.column_stack([reach, np.roll(reach, -1)])[..., None]
    )
    return corners[..., 0]


def area_m2(corners: Floats) -> float:
    """Area of a simple polygon (K, 2)."""
    x, y = corners.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


Floats = NDArray[np.float64]
Document = dict[str, Any]

KEPT: Final = 24  # sweeps whose points are kept in memory
_CELL_M: Final = 0.4
_WIDEST_M: Final = 2.2  # a person with a board, and what the grid adds
_TALLEST_M: Final = 2.8
_POINTS_AT_1_M: Final = 100.0  # a person-sized thing has more points than this over its distance
_FEWEST_POINTS: Final = 4
_OFF_GROUND_M: Final = 0.12
_ABOVE_M: Final = 0.3
_REACH_M: Final = 2.8  # a board held up
_POST_M: Final = 1.5
_MOST_POSTS: Final = 16


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A region document (see `region_document`), and what it rests on (``SuggestionFacts`` of the documents)."""

    document: Document
    facts: Document


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """A cluster of person's size that moves: its points (N, 3), and the middle of them on the ground (2,)."""

    points: Floats
    middle: Floats


@dataclass(slots=True)
class ObservedScene:
    """What the second reading gathers: by sweep what moves, of some sweeps all points and those that stand still."""

    points: int = 0
    still: int = 0
    things: list[list[Thing]] = field(default_factory=list[list[Thing]])
    clouds: dict[int, NDArray[np.float32]] = field(default_factory=dict[int, NDArray[np.float32]])
    background: list[Floats] = field(default_factory=list[Floats])


def things_of(xyz: Floats) -> list[Thing]:
    """The things of a person's size among points (N, 3) that move."""
    if not len(xyz):
        return []
    cluster = clusters(xyz[:, :2], _CELL_M)
    things: list[Thing] = []
    for number in np.flatnonzero(np.bincount(cluster) >= _FEWEST_POINTS):
        points = xyz[cluster == number]
        size = np.ptp(points, axis=0)
        middle = points[:, :2].mean(axis=0)
        enough = len(points) >= _POINTS_AT_1_M / max(float(np.hypot(*middle)), 1.0)
        if enough and np.hypot(size[0], size[1]) <= _WIDEST_M and size[2] <= _TALLEST_M:
            things.append(Thing(points, middle))
    return things


def describe(
    things: Sequence[Sequence[Thing]],
    scene: ObservedScene,
    margin_m: float,
    *,
    poses: int = 0,
    notes: Sequence[str] = (),
) -> Suggestion:
    """The region around what moved in each sweep.

    Args:
        poses: how many still poses the recording has; 0 for a walk. Of poses the detectors leave out what stands
            still, so that nothing is cut out for it here.
    """
    points = np.concatenate([thing.points for some in things for thing in some])
    corners = area_around(points[:, :2], margin_m)
    still = np.concatenate(scene.background)
    inside = still[Region.from_document({"polygon": corners.tolist()}).mask(still)]
    sentences = list(notes)
    # What rises or stands still matters to detectors that do not know the backdrop.
    left_in = [] if poses else sentences
    ground, z_low = _ground(points, inside, left_in)
    # A sensor of few rings may never have met the board where it was highest.
    z_high = max(float(np.max(points[:, 2])) + _ABOVE_M, ground + _REACH_M)
    posts = [] if poses else _posts(inside[(inside[:, 2] > z_low) & (inside[:, 2] < z_high)], left_in)
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
    counts = [int(np.count_nonzero(region.mask(xyz))) for number, xyz in scene.clouds.items() if things[number]]
    facts: Document = {
        "sweeps_read": len(things),
        "sweeps_moving": sum(bool(some) for some in things),
        "points_per_sweep": float(np.median(counts)) if counts else 0.0,
        "area_m2": round(area_m2(corners), 1),
        "ground_z": round(ground, 2),
        "z_low": round(z_low, 2),
        "z_high": round(z_high, 2),
        "posts": len(posts),
        "notes": sentences,
        "poses": poses,
    }
    return Suggestion(document, facts)


def levelled(xyz: NDArray[np.float32], level: Floats) -> NDArray[np.float32]:
    """Points (N, 3) in level axes, by R_level_lidar (3, 3); the same array where the LiDAR stands upright."""
    return xyz if level[2, 2] == 1.0 else (xyz @ level.T).astype(xyz.dtype)


def in_level_axes(suggestion: Suggestion, level: Floats) -> Suggestion:
    """The suggestion as one that says in which axes it was made."""
    if level[2, 2] == 1.0:
        return suggestion
    tilt = math.degrees(math.acos(float(level[2, 2])))
    note = f"The ground tells that the LiDAR is tilted by {tilt:.0f} degrees. The region is in level axes."
    document: Document = {"level": suggestion.document, "up": [round(value, 5) for value in level[2].tolist()]}
    return Suggestion(document, suggestion.facts | {"notes": [note, *suggestion.facts["notes"]]})


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
        for number in np.flatnonzero(np.bincount(cluster) >= KEPT // 2):
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
