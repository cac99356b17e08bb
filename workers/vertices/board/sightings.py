# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
"""Planes of a sweep that could be the board's, with the rays that show where the board in each of them ends.

On rings they grow from stretches of neighbouring rings. Without rings they grow from where points stand close; then
every return tells what its own ray met, and none tells where nothing came back.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from workers.readers.recording import Sweep
from workers.vertices.board.model import TELLING_RINGS, BoardModel, Floats, Plane, Sighting
from workers.vertices.board.planes import find_stretches, grow_planes, pair_stretches
from workers.vertices.board.rays import choose_rays, follow_board, likelihood_ratios, mixed_rays
from workers.vertices.range_image import RangeImage, clusters, groups, open_window, scattered_window
from workers.vertices.sensor_grid import SensorGrid

_WIDEST_M: Final = 1.8  # a stretch of points on a ring that is wider is no board
_NARROWEST_M: Final = 0.26
_PAIRS: Final = 8
_ON_BOARD: Final = 2.0  # likelihood ratio from which a point counts as the board's
CONFIDENT: Final = 5.0
# Pulses last 4 to 6 ns; echoes that are less than c t / 2 apart become one.
_PULSE_M: Final = 0.9
_OFF: Final = 4.0  # standard deviations behind the plane: the return is not of the board alone
_BESIDE_RAD: Final = 0.2  # half of a board of 1.4 m, 3.5 m away
_SEED_M: Final = 0.15
_SEEDS: Final = 8
_FEWEST: Final = 6
_TELLING_POINTS: Final = 16  # four rings of four
_NEIGHBOURS: Final = 4
_CONNECTED: Final = 1.5  # of the distance to the fourth neighbour


def open_windows(sweep: Sweep, inside: NDArray[np.bool_], grid: SensorGrid) -> list[RangeImage]:
    """A window around every group of points that lie in the region."""
    if grid.scattered:
        return [
            scattered_window(sweep, inside, grid.R_level_lidar, centre, half, _BESIDE_RAD)
            for centre, half in groups(sweep.xyz[inside])
        ]
    return [
        open_window(sweep, inside, grid, centre, half + 5.0 * float(grid.steps.max()))
        for centre, half in groups(sweep.xyz[inside])
    ]


def find_planes(windows: Iterable[RangeImage], model: BoardModel, most: int) -> list[Sighting]:
    """Planes that could be the board's, the likeliest first; at least two rings meet each, where there are rings."""
    if model.grid.scattered:
        scattered = [sighting for window in windows for sighting in _scattered(window, model)]
        # A thing at the rim of two windows is met in both, and gaps between a pattern's petals may part a board.
        once = {round(s.plane.score, 1): s for s in sorted(scattered, key=lambda sighting: sighting.plane.points)}
        return sorted(once.values(), key=lambda sighting: -sighting.plane.score)[:most]
    candidates: list[tuple[float, RangeImage, Floats, Floats, tuple[int, int, int]]] = []
    prior = np.array([*model.yaw, *model.tilt])
    for window in windows:
        stretches = find_stretches(window.azimuth, window.distance, window.inside, model.sigma, window.steps)
        pairs = pair_stretches(stretches, window.slope, _WIDEST_M, _PAIRS)
        planes, infos, scores, pair_of = grow_planes(
            window.azimuth, window.slope, window.distance, window.inside, stretches, pairs, model.sigma, prior
        )
        for w, info, score, number in zip(planes, infos, scores.tolist(), pair_of, strict=True):
            r, first, last = stretches[pairs[number, 0], :3].astype(int).tolist()
            candidates.append((score, window, w, np.asarray(np.linalg.inv(info), np.float64), (r, first, last)))
    candidates.sort(key=lambda item: -item[0])
    sightings: list[Sighting] = []
    for item in candidates:
        sighting = _with_rays(*item, model)
        if sighting is not None and _at_most(sighting.plane, model) > _NARROWEST_M:
            sightings.append(sighting)
            if len(sightings) == most:
                break
    return sightings


def _at_most(plane: Plane, model: BoardModel) -> float:
    """Metres that the board takes at most on a ring, with the gaps to the next rays; a pole or an arm takes less."""
    return plane.width + (float(model.grid.steps.max()) + 2.0 * model.growth) * float(np.median(plane.reach))


def _with_rays(
    score: float, window: RangeImage, w: Floats, spread: Floats, seed: tuple[int, int, int], model: BoardModel
) -> Sighting | None:
    image = window.azimuth, window.slope, window.distance
    left, up, ratio = likelihood_ratios(*image, w, spread, model.sigma, model.lost)
    ends = follow_board(left, up, ratio, window.inside, *seed)
    on_board = np.flatnonzero(ends[:, 0] >= 0)
    if on_board.size < 2:
        return None
    at = tuple(choose_rays(left, up, ratio, window.distance, ends).T)
    u = w[0] * np.cos(window.azimuth[at]) + w[1] * np.sin(window.azimuth[at]) + w[2] * window.slope[at]
    column: NDArray[np.int64] = np.arange(int(ratio.shape[1]))
    between: NDArray[np.bool_] = (column >= ends[:, :1]) & (column <= ends[:, 1:]) & (ends[:, :1] >= 0)
    on_points = between & (ratio > _ON_BOARD)
    points = int(np.count_nonzero(on_points))
    hits = np.nonzero(between & (ratio > CONFIDENT))
    hit_at: Floats = np.stack([left[hits], up[hits]])
    # Rings so far apart that a board holds fewer of them have met a body too.
    apart = float(np.median(np.diff(window.slope[on_board, window.slope.shape[1] // 2])) / np.median(u))
    reach = np.sqrt(1.0 + window.slope[at] ** 2) / u
    widths = (1 + ends[on_board, 1] - ends[on_board, 0]) * window.steps[on_board]
    widest = int(on_board[np.argmax(widths)])
    level = float(up[widest, ends[widest].sum() // 2])
    off = (_OFF * model.sigma, _PULSE_M)
    missed = np.nonzero((window.distance > 0.0) & (ratio < 1.0 / CONFIDENT) & _may_be_board(left, up, hit_at, model))
    near = np.nonzero((ratio > CONFIDENT) & _may_be_board(left, up, hit_at, model))
    plane = Plane(
        R_window_lidar=window.R_window_lidar,
        w=w,
        spread=spread,
        uneven=_of_rings(w, spread, window, on_points, model),
        score=score,
        left=left[at],
        up=up[at],
        reach=reach,
        ratio=ratio[at],
        below=up[at] < level,
        mixed=mixed_rays(*image, w, *off, *at),
        hits=hit_at,
        misses=np.stack([left[missed], up[missed], mixed_rays(*image, w, *off, *missed).astype(np.float64)]),
        near=np.stack([left[near], up[near], window.inside[near].astype(np.float64)]),
        rings=int(on_board.size),
        top_ring=int(window.ring[on_board[-1]]),
        points=points,
        width=(float(widths.max()) - 2.0 * model.growth) * float(np.median(reach)),
        returned=window.distance[at] > 0.0,
        telling=on_board.size >= TELLING_RINGS and (TELLING_RINGS - 1) * apart < math.hypot(*model.edges),
    )
    return Sighting(plane, window, ends)


def _of_rings(
    w: Floats, spread: Floats, window: RangeImage, on_board: NDArray[np.bool_], model: BoardModel
) -> Floats:
    """What is added (3, 3) to the covariance of a plane's w, because its points (R, C) share their ring's error."""
    if model.ring_bias == 0.0:
        return np.zeros((3, 3))
    ring, column = np.nonzero(on_board)
    azimuth, slope = window.azimuth[ring, column], window.slope[ring, column]
    rays = np.stack([np.cos(azimuth), np.sin(azimuth), slope])
    # By what a metre of distance changes the right side of the normal equations.
    pull = rays / (w @ rays) ** 2 / model.sigma**2
    count = np.bincount(ring)
    of_ring = np.stack([np.bincount(ring, part) for part in pull])[:, count > 0]
    alike = 1.0 - 1.0 / count[count > 0]
    more: Floats = model.ring_bias**2 * spread @ ((of_ring * alike) @ of_ring.T) @ spread
    return more


def _may_be_board(left: Floats, up: Floats, hits: Floats, model: BoardModel) -> NDArray[np.bool_]:
    """Where in a plane a board may be that holds all hits (2, H)."""
    if not hits.size:
        return np.zeros(left.shape, np.bool_)
    widest = math.hypot(*model.edges) + 2.0 * model.slack
    low_left, low_up = (hits.max(axis=1) - widest).tolist()
    high_left, high_up = (hits.min(axis=1) + widest).tolist()
    return (left > low_left) & (left < high_left) & (up > low_up) & (up < high_up)


def _scattered(window: RangeImage, model: BoardModel) -> Iterator[Sighting]:
    """Planes of a window without rings: the densest places first, none of a plane that there is already."""
    azimuth, slope, distance = window.azimuth[0], window.slope[0], window.distance[0]
    (inside,) = np.nonzero(window.inside[0])
    if inside.size < _FEWEST:
        return
    xyz = np.column_stack([np.cos(azimuth), np.sin(azimuth), slope])[inside] * distance[inside, None]
    crowd = KDTree(xyz).query_ball_point(xyz, _SEED_M, return_length=True)
    free: NDArray[np.bool_] = crowd >= _FEWEST
    met = np.zeros(azimuth.size, np.bool_)
    prior = np.array([*model.yaw, *model.tilt])
    for _ in range(_SEEDS):
        if not free.any():
            return
        middle = int(np.argmax(np.where(free, crowd, 0)))
        away = np.linalg.norm(xyz - xyz[middle], axis=1)
        order = np.argsort(away)[: np.count_nonzero(away < _WIDEST_M)]
        free[order[: crowd[middle]]] = False
        # The points at the seed start the plane, as a stretch and its neighbour do on rings.
        start = np.array([[0.0, 0.0, crowd[middle] - 1.0]])
        near = inside[order]
        rows = azimuth[near][None], slope[near][None], distance[near][None]
        planes, infos, scores, _ = grow_planes(
            *rows, np.ones((1, order.size), np.bool_), start, np.zeros((1, 2), np.int64), model.sigma, prior
        )
        best = int(np.argmax(scores))
        w, spread = planes[best], np.asarray(np.linalg.inv(infos[best]), np.float64)
        left, up, ratio = (
            part[0]
            for part in likelihood_ratios(
                window.azimuth, window.slope, window.distance, w, spread, model.sigma, model.lost
            )
        )
        (on_plane,) = np.nonzero((ratio > _ON_BOARD) & window.inside[0])
        if on_plane.size < _FEWEST:
            continue
        thing = on_plane[_connected(left[on_plane], up[on_plane], np.isin(on_plane, inside[order[: crowd[middle]]]))]
        free[np.isin(inside, thing)] = False
        if met[thing].mean() > 0.5:
            continue
        met[thing] = True
        if thing.size >= _FEWEST and max(np.ptp(left[thing]), np.ptp(up[thing])) < _at_largest(model):
            yield _of_thing(window, w, spread, float(scores[best]), left, up, ratio, thing, model)


def _connected(left: Floats, up: Floats, start: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which points of a plane (N,) belong to the thing with most of those of ``start`` (N,), at their own density."""
    at = np.column_stack([left, up])
    apart = KDTree(at).query(at, min(_NEIGHBOURS + 1, len(at)))[0][:, -1]
    label = clusters(at, max(_CONNECTED * float(np.median(apart)), 0.01))
    return label == np.argmax(np.bincount(label, start + 1e-6))


def _at_largest(model: BoardModel) -> float:
    """Metres that a board takes at most, with what beams add at its edges; infinite if its size is open."""
    return math.hypot(*model.edges) + 2.0 * model.slack + 2.0 * _NARROWEST_M if all(model.edges) else math.inf


def _of_thing(
    window: RangeImage, w: Floats, spread: Floats, score: float, left: Floats, up: Floats, ratio: Floats,
    thing: NDArray[np.int64], model: BoardModel,
) -> Sighting:  # fmt: skip
    hits = thing[ratio[thing] > CONFIDENT]
    hit_at: Floats = np.stack([left[hits], up[hits]])
    around = _may_be_board(left, up, hit_at, model)
    (behind,) = np.nonzero((ratio < 1.0) & (ratio > 0.0) & around)
    (missed,) = np.nonzero((ratio < 1.0 / CONFIDENT) & around)
    (near,) = np.nonzero((ratio > CONFIDENT) & around)
    at = np.concatenate([thing, np.setdiff1d(behind, thing)])
    image = window.azimuth, window.slope, window.distance
    azimuth, slope = window.azimuth[0, at], window.slope[0, at]
    reach = np.sqrt(1.0 + slope**2) / (w[0] * np.cos(azimuth) + w[1] * np.sin(azimuth) + w[2] * slope)
    row = np.zeros(window.azimuth.size, np.int64)

    def mixed(of: NDArray[np.int64]) -> NDArray[np.bool_]:
        return mixed_rays(*image, w, _OFF * model.sigma, _PULSE_M, row[of], of)

    plane = Plane(
        R_window_lidar=window.R_window_lidar,
        w=w,
        spread=spread,
        uneven=np.zeros((3, 3)),
        score=score,
        left=left[at],
        up=up[at],
        reach=reach,
        ratio=ratio[at],
        below=up[at] < np.median(up[thing]),
        mixed=mixed(at),
        hits=hit_at,
        misses=np.stack([left[missed], up[missed], mixed(missed).astype(np.float64)]),
        near=np.stack([left[near], up[near], window.inside[0, near].astype(np.float64)]),
        rings=0,
        top_ring=0,
        points=int(thing.size),
        width=float(np.ptp(left[thing])),
        returned=np.ones(at.size, np.bool_),
        telling=thing.size >= _TELLING_POINTS,
    )
    return Sighting(plane, window, np.array([[0, window.azimuth.size - 1]]))
