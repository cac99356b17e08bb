# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
"""Things of a person's size in a sweep, and a region document around them.

Things are clusters of what moves, or upright pieces by their shape alone. The suggested region is the convex polygon
around the clusters seen from above, off the ground, with the posts inside cut out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from workers.readers.recording import Sweep
from workers.vertices.board.planes import find_segments
from workers.vertices.range_image import RangeImage, clusters, open_window
from workers.vertices.region import Region
from workers.vertices.sensor_grid import SensorGrid

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CELL_M: Final = 0.4
_WIDEST_M: Final = 2.2  # a person with a board held out
_TALLEST_M: Final = 2.8
_POINTS_AT_1_M: Final = 100.0  # a person-sized thing has more points than this over its distance
_FEWEST_POINTS: Final = 4
_BY_CHANCE: Final = 2.0  # standard deviations of a count
_SECTORS: Final = 4
_OVERLAP: Final = math.radians(20.0)  # somebody with a board 2.5 m away
_SIGMA_M: Final = 0.03  # data sheets
_FEWEST: Final = 8
_GAP_M: Final = 0.1
_DIRECTION_DEG: Final = 2.0
_MOVED_SHARE: Final = 0.2  # of the points in a direction; the ground there looks alike from everywhere


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """A cluster of a person's size: its points (N, 3), and the middle of them on the ground (2,)."""

    points: Floats
    middle: Floats

    @property
    def face(self) -> float:
        """Least number of points it would have one metre away: a few points of a far tree may be chance."""
        count = len(self.points)
        return max(count - _BY_CHANCE * math.sqrt(count), 0.0) * float(self.middle @ self.middle)


def things_of(xyz: Floats) -> list[Thing]:
    """Return the things of a person's size among points (N, 3), the largest face first."""
    if not len(xyz):
        return []
    cluster = clusters(xyz[:, :2], _CELL_M)
    things: list[Thing] = []
    for number in np.flatnonzero(np.bincount(cluster) >= _FEWEST_POINTS):
        points = xyz[cluster == number]
        thing = Thing(points, points[:, :2].mean(axis=0))
        enough = len(points) >= _POINTS_AT_1_M / max(float(np.hypot(*thing.middle)), 1.0)
        if enough and _is_small(points):
            things.append(thing)
    return sorted(things, key=lambda thing: -thing.face)


def upright_pieces(sweep: Sweep, inside: Mask, grid: SensorGrid) -> list[Mask]:
    """Return masks (N,) of upright pieces of at least two rings among the points ``inside`` (N,), the largest first.

    Returns along a ring belong together if their ranges do not jump, segments of neighbouring rings if one stands
    above the other. Walls, cars and the ground make pieces that are too large. A piece at the rim of a sector may
    occur twice.
    """
    half = math.pi / _SECTORS + _OVERLAP
    pieces: list[NDArray[np.int64]] = []
    for number in range(_SECTORS):
        window = open_window(sweep, inside, grid, (2 * number + 1) * math.pi / _SECTORS - math.pi, half)
        pieces += _pieces(window)
    pieces.sort(key=len, reverse=True)
    return [np.isin(np.arange(len(inside)), points) for points in pieces if _is_small(sweep.xyz[points])]


def _is_small(points: NDArray[np.floating]) -> bool:
    """Return whether points (N, 3) take no more space than a person with a board."""
    width, depth, height = np.ptp(points, axis=0).tolist()
    return math.hypot(width, depth) <= _WIDEST_M and height <= _TALLEST_M


def _pieces(window: RangeImage) -> list[NDArray[np.int64]]:
    """Return the indices of the points of each piece."""
    segments = find_segments(window.azimuth, window.distance, window.inside, _SIGMA_M, window.steps)
    if not len(segments):
        return []
    pairs = np.array(_stacked(segments, window.slope)).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), pairs.T), (len(segments), len(segments)))
    piece_of = connected_components(graph, directed=False)[1]
    pieces: list[NDArray[np.int64]] = []
    for number in range(int(piece_of.max()) + 1):
        members = segments[piece_of == number]
        points = np.concatenate([_points(window, segment) for segment in members])
        if np.unique(members[:, 0]).size >= 2 and points.size >= _FEWEST:
            pieces.append(points)
    return pieces


def _points(window: RangeImage, segment: Floats) -> NDArray[np.int64]:
    ring, first, last = (int(value) for value in segment[:3])
    run = slice(first, last + 1)
    point = window.point[ring, run]
    return point[(point >= 0) & window.inside[ring, run]]


def _stacked(segments: Floats, slope: Floats) -> Sequence[tuple[int, int]]:
    """Return pairs of segments on neighbouring rings, one above the other, as on one upright surface."""
    pairs: list[tuple[int, int]] = []
    middle = slope.shape[1] // 2
    for ring in np.unique(segments[:, 0]).astype(int).tolist():
        upper, lower = (np.flatnonzero(segments[:, 0] == number) for number in (ring, ring - 1))
        if not lower.size:
            continue
        rise = abs(float(slope[ring, middle] - slope[ring - 1, middle]))
        higher, other = segments[upper], segments[lower]
        away = np.abs(higher[:, None, 6] - other[None, :, 6])
        gap = np.maximum(other[None, :, 4] - higher[:, None, 5], higher[:, None, 4] - other[None, :, 5])
        # A board leans by slopes of up to 0.7.
        near = (away <= _GAP_M + 0.7 * rise * higher[:, None, 6]) & (gap <= _GAP_M)
        pairs += [(int(upper[i]), int(lower[j])) for i, j in np.argwhere(near).tolist()]
    return pairs


Floats = NDArray[np.float64]
Document = dict[str, Any]

SIDES: Final = 20  # of the areas that are suggested
KEPT: Final = 24  # sweeps whose points are kept in memory
_OFF_GROUND_M: Final = 0.12
_ABOVE_M: Final = 0.3
_REACH_M: Final = 2.8  # a board held up
_POST_M: Final = 1.5
_MOST_POSTS: Final = 16


def area_around(xy: Floats, margin_m: float) -> Floats:
    """Return the corners (SIDES, 2), counter-clockwise, of a convex polygon ``margin_m`` outside of points (N, 2).

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
    """Return the area of a simple polygon (K, 2)."""
    x, y = corners.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A region document (see `region_document`), and what it rests on (``SuggestionFacts`` of the documents)."""

    document: Document
    facts: Document


@dataclass(slots=True)
class ObservedScene:
    """Some sweeps in level axes: the moving things of each, and of a few all points and the static ones."""

    sweeps: int
    shares: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    things: list[list[Thing]] = field(default_factory=list[list[Thing]])
    clouds: dict[int, NDArray[np.float32]] = field(default_factory=dict[int, NDArray[np.float32]])
    background: list[Floats] = field(default_factory=list[Floats])

    @property
    def still(self) -> float:
        """Share of the points that are static: median of the sweeps."""
        return float(np.median([share for share, _ in self.shares]))

    @property
    def around(self) -> float:
        """Share of the directions in which a fifth of the points moved: median of the sweeps."""
        return float(np.median([share for _, share in self.shares]))

    def add(self, things: list[Thing], xyz: NDArray[np.float32], still: Mask, moved: Mask) -> None:
        """Add the next sweep: its points (N, 3), which of them stand still and which moved."""
        number = len(self.things)
        self.things.append(things)
        if len(xyz):
            direction = np.floor(np.degrees(np.arctan2(xyz[:, 1], xyz[:, 0])) / _DIRECTION_DEG).astype(int)
            direction -= direction.min()
            every, moving = np.bincount(direction), np.bincount(direction, moved)
            filled = np.count_nonzero(every)
            self.shares.append((float(still.mean()), np.count_nonzero(moving > _MOVED_SHARE * every) / filled))
        if number % max(1, self.sweeps // KEPT) == 0:
            self.clouds[number] = xyz
            self.background.append(xyz[still].astype(np.float64))


def describe(
    things: Sequence[Sequence[Thing]],
    scene: ObservedScene,
    margin_m: float,
    *,
    poses: int = 0,
    notes: Sequence[str] = (),
) -> Suggestion:
    """Return the region around what moved in each sweep.

    Args:
        poses: number of still poses; 0 for a walk. In poses the detectors leave out the static background, so
            nothing is cut out here.
    """
    points = np.concatenate([thing.points for some in things for thing in some])
    corners = area_around(points[:, :2], margin_m)
    still = np.concatenate(scene.background)
    inside = still[Region.from_document({"all": [{"polygon": corners.tolist()}]}).mask(still)]
    sentences = list(notes)
    # Rising ground and static things matter to detectors that do not leave out the background.
    left_in = [] if poses else sentences
    ground, z_low = _ground(points, inside, left_in)
    # A sensor of few rings may never have met the board where it was highest.
    z_high = max(float(np.max(points[:, 2])) + _ABOVE_M, ground + _REACH_M)
    posts = [] if poses else _posts(inside[(inside[:, 2] > z_low) & (inside[:, 2] < z_high)], left_in)
    heights = [round(z_low, 2), round(z_high, 2)]
    area = {"polygon": [[round(x, 2), round(y, 2)] for x, y in corners.tolist()], "z": heights}
    document: Document = {"all": [area]}
    if posts:
        document["none"] = [{"box": {"min": [*low, heights[0]], "max": [*high, heights[1]]}} for low, high in posts]
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
    """Return points (N, 3) in level axes, by R_level_lidar (3, 3); the same array if the LiDAR stands upright."""
    return xyz if level[2, 2] == 1.0 else (xyz @ level.T).astype(xyz.dtype)


def in_level_axes(suggestion: Suggestion, level: Floats) -> Suggestion:
    """Return the suggestion with its axes stated, if the LiDAR is not upright."""
    if level[2, 2] == 1.0:
        return suggestion
    tilt = math.degrees(math.acos(float(level[2, 2])))
    how = f"is tilted by {tilt:.0f} degrees" if tilt < 90.0 else f"hangs, {180.0 - tilt:.0f} degrees off upside down"
    note = f"The ground tells that the LiDAR {how}. The region is in level axes."
    document: Document = {**suggestion.document, "up": [round(value, 5) for value in level[2].tolist()]}
    return Suggestion(document, suggestion.facts | {"notes": [note, *suggestion.facts["notes"]]})


def _ground(points: Floats, still: Floats, notes: list[str]) -> tuple[float, float]:
    """Return the height of the ground where the person walked, and the least height that the region keeps."""
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
    """Return lower and upper corner (x, y) of boxes around small static things; larger things stay in."""
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
