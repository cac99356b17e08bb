# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
"""The search for candidates: planes in a sweep's windows, each with the rays that show where a board in it ends.

On rings a plane grows from two segments of points on neighbouring rings, and the board is followed from ring to ring.
Without rings a plane grows from where points are dense. Then each return says what its own ray met, and nothing says
where a ray had no return.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from workers.readers.recording import Sweep
from workers.vertices.board.candidate import (
    MANY_RINGS,
    EdgeRays,
    Mask,
    Plane,
    PlaneCandidate,
    PlaneExtent,
    PlaneReturns,
)
from workers.vertices.board.model import BoardModel, Floats
from workers.vertices.board.planes import find_segments, grow_planes, pair_segments
from workers.vertices.board.rays import choose_rays, follow_board, likelihood_ratios, mixed_rays
from workers.vertices.range_image import RangeImage, cluster_sectors, clusters, open_window, scattered_window
from workers.vertices.sensor_grid import SensorGrid

_WIDEST_M: Final = 1.8  # a wider segment of points on a ring is no board
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
_MANY_POINTS: Final = 16  # four rings of four
_NEIGHBOURS: Final = 4
_CONNECTED: Final = 1.5  # of the distance to the fourth neighbour


def open_windows(sweep: Sweep, inside: Mask, grid: SensorGrid) -> list[RangeImage]:
    """Return a window around every cluster of the points that lie in the region, (N,) ``inside``."""
    clusters_of_points = cluster_sectors(sweep.xyz[inside])
    if grid.scattered:
        return [
            scattered_window(sweep, inside, grid.R_level_lidar, centre, half, _BESIDE_RAD)
            for centre, half in clusters_of_points
        ]
    margin = 5.0 * float(grid.steps.max())
    return [open_window(sweep, inside, grid, centre, half + margin) for centre, half in clusters_of_points]


def find_planes(windows: Iterable[RangeImage], model: BoardModel, most: int) -> list[PlaneCandidate]:
    """Return the ``most`` likeliest candidates, the likeliest first; on sensors with rings at least two meet each."""
    if model.grid.scattered:
        scattered = [candidate for window in windows for candidate in _scattered_candidates(window, model)]
        # A cluster at the rim of two windows is met in both, and gaps between a pattern's petals may part a board.
        scattered.sort(key=lambda candidate: candidate.plane.extent.points)
        once = {round(candidate.plane.score, 1): candidate for candidate in scattered}
        return sorted(once.values(), key=lambda candidate: -candidate.plane.score)[:most]
    grown: list[tuple[float, RangeImage, Floats, Floats, tuple[int, int, int]]] = []
    prior = np.array([*model.yaw, *model.tilt])
    for window in windows:
        segments = find_segments(window.azimuth, window.distance, window.inside, model.sigma, window.steps)
        pairs = pair_segments(segments, window.slope, _WIDEST_M, _PAIRS)
        planes, infos, scores, pair_of = grow_planes(
            window.azimuth, window.slope, window.distance, window.inside, segments, pairs, model.sigma, prior
        )
        for w, info, score, number in zip(planes, infos, scores.tolist(), pair_of, strict=True):
            r, first, last = segments[pairs[number, 0], :3].astype(int).tolist()
            grown.append((score, window, w, np.asarray(np.linalg.inv(info), np.float64), (r, first, last)))
    grown.sort(key=lambda item: -item[0])
    candidates: list[PlaneCandidate] = []
    for item in grown:
        candidate = _candidate_on_rings(*item, model)
        if candidate is not None and _greatest_width_m(candidate.plane, model) > _NARROWEST_M:
            candidates.append(candidate)
            if len(candidates) == most:
                break
    return candidates


def _greatest_width_m(plane: Plane, model: BoardModel) -> float:
    """Return the greatest width that a board may have on a ring, gaps to the next rays included.

    A pole or an arm is narrower than any board.
    """
    gaps = float(model.grid.steps.max()) + 2.0 * model.blooming
    return plane.extent.width + gaps * float(np.median(plane.rays.reach))


def _candidate_on_rings(
    score: float, window: RangeImage, w: Floats, covariance: Floats, seed: tuple[int, int, int], model: BoardModel
) -> PlaneCandidate | None:
    """Return the candidate in the plane ``w`` that is followed from a segment; None if it is on one ring alone.

    Args:
        seed: ring, first column and last column of the segment.
    """
    image = window.azimuth, window.slope, window.distance
    left, up, ratio = likelihood_ratios(*image, w, covariance, model.sigma, model.dropout_rate)
    ends = follow_board(left, up, ratio, window.inside, *seed)
    on_board = np.flatnonzero(ends[:, 0] >= 0)
    if on_board.size < 2:
        return None
    at = tuple(choose_rays(left, up, ratio, window.distance, ends).T)
    u = w[0] * np.cos(window.azimuth[at]) + w[1] * np.sin(window.azimuth[at]) + w[2] * window.slope[at]
    column: NDArray[np.int64] = np.arange(int(ratio.shape[1]))
    between: Mask = (column >= ends[:, :1]) & (column <= ends[:, 1:]) & (ends[:, :1] >= 0)
    on_points = between & (ratio > _ON_BOARD)
    is_hit: Mask = between & (ratio > CONFIDENT)
    hits = np.nonzero(is_hit)
    is_hit[at] = False
    inner = np.nonzero(is_hit)
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
    is_mixed, has_return = mixed_rays(*image, w, *off, *at), window.distance[at] > 0.0
    rays = EdgeRays(left[at], up[at], reach, ratio[at], up[at] < level, is_mixed, has_return)
    returns = PlaneReturns(
        hits=hit_at,
        misses=np.stack([left[missed], up[missed], mixed_rays(*image, w, *off, *missed).astype(np.float64)]),
        near=np.stack([left[near], up[near], window.inside[near].astype(np.float64)]),
        inner=np.stack([left[inner], up[inner], ratio[inner]]),
    )
    extent = PlaneExtent(
        rings=int(on_board.size),
        top_ring=int(window.ring[on_board[-1]]),
        points=int(np.count_nonzero(on_points)),
        width=(float(widths.max()) - 2.0 * model.blooming) * float(np.median(reach)),
        has_many_rings=on_board.size >= MANY_RINGS and (MANY_RINGS - 1) * apart < math.hypot(*model.edges),
    )
    by_rings = _ring_covariance(w, covariance, window, on_points, model)
    plane = Plane(window.R_window_lidar, w, covariance, by_rings, score, rays, returns, extent)
    return PlaneCandidate(plane, window, ends)


def _ring_covariance(w: Floats, covariance: Floats, window: RangeImage, on_board: Mask, model: BoardModel) -> Floats:
    """Return (3, 3) added to the covariance of a plane's w, because its points (R, C) share their ring's error."""
    if model.ring_bias == 0.0:
        return np.zeros((3, 3))
    ring, column = np.nonzero(on_board)
    azimuth, slope = window.azimuth[ring, column], window.slope[ring, column]
    rays = np.stack([np.cos(azimuth), np.sin(azimuth), slope])
    # By what a metre of distance changes the right side of the normal equations.
    pull = rays / (w @ rays) ** 2 / model.sigma**2
    count = np.bincount(ring)
    by_ring = np.stack([np.bincount(ring, part) for part in pull])[:, count > 0]
    shared = 1.0 - 1.0 / count[count > 0]
    more: Floats = model.ring_bias**2 * covariance @ ((by_ring * shared) @ by_ring.T) @ covariance
    return more


def _may_be_board(left: Floats, up: Floats, hits: Floats, model: BoardModel) -> Mask:
    """Return which points of a plane may lie on a board that holds all hits (2, H)."""
    if not hits.size:
        return np.zeros(left.shape, np.bool_)
    widest = math.hypot(*model.edges) + 2.0 * model.slack
    low_left, low_up = (hits.max(axis=1) - widest).tolist()
    high_left, high_up = (hits.min(axis=1) + widest).tolist()
    return (left > low_left) & (left < high_left) & (up > low_up) & (up < high_up)


def _scattered_candidates(window: RangeImage, model: BoardModel) -> Iterator[PlaneCandidate]:
    """Yield the candidates of a window without rings, the densest first, each cluster once."""
    azimuth, slope, distance = window.azimuth[0], window.slope[0], window.distance[0]
    (inside,) = np.nonzero(window.inside[0])
    if inside.size < _FEWEST:
        return
    xyz = np.column_stack([np.cos(azimuth), np.sin(azimuth), slope])[inside] * distance[inside, None]
    crowd = KDTree(xyz).query_ball_point(xyz, _SEED_M, return_length=True)
    free: Mask = crowd >= _FEWEST
    met = np.zeros(azimuth.size, np.bool_)
    prior = np.array([*model.yaw, *model.tilt])
    for _ in range(_SEEDS):
        if not free.any():
            return
        middle = int(np.argmax(np.where(free, crowd, 0)))
        away = np.linalg.norm(xyz - xyz[middle], axis=1)
        order = np.argsort(away)[: np.count_nonzero(away < _WIDEST_M)]
        free[order[: crowd[middle]]] = False
        # The points at the seed start the plane, as a segment and its neighbour do on rings.
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
                window.azimuth, window.slope, window.distance, w, spread, model.sigma, model.dropout_rate
            )
        )
        (on_plane,) = np.nonzero((ratio > _ON_BOARD) & window.inside[0])
        if on_plane.size < _FEWEST:
            continue
        cluster = on_plane[
            _connected(left[on_plane], up[on_plane], np.isin(on_plane, inside[order[: crowd[middle]]]))
        ]
        free[np.isin(inside, cluster)] = False
        if met[cluster].mean() > 0.5:
            continue
        met[cluster] = True
        if cluster.size >= _FEWEST and max(np.ptp(left[cluster]), np.ptp(up[cluster])) < _greatest_extent_m(model):
            yield _scattered_candidate(window, w, spread, float(scores[best]), left, up, ratio, cluster, model)


def _connected(left: Floats, up: Floats, start: Mask) -> Mask:
    """Return which points of a plane (N,) form the cluster with most points of ``start`` (N,), at their density."""
    at = np.column_stack([left, up])
    apart = KDTree(at).query(at, min(_NEIGHBOURS + 1, len(at)))[0][:, -1]
    label = clusters(at, max(_CONNECTED * float(np.median(apart)), 0.01))
    return label == np.argmax(np.bincount(label, start + 1e-6))


def _greatest_extent_m(model: BoardModel) -> float:
    """Return how far a board extends at most, in metres, blooming included; infinite if its size is open."""
    return math.hypot(*model.edges) + 2.0 * model.slack + 2.0 * _NARROWEST_M if all(model.edges) else math.inf


def _scattered_candidate(
    window: RangeImage, w: Floats, covariance: Floats, score: float, left: Floats, up: Floats, ratio: Floats,
    cluster: NDArray[np.int64], model: BoardModel,
) -> PlaneCandidate:  # fmt: skip
    """Return the candidate of a cluster (indices of points) in a plane ``w`` without rings."""
    hits = cluster[ratio[cluster] > CONFIDENT]
    hit_at: Floats = np.stack([left[hits], up[hits]])
    around = _may_be_board(left, up, hit_at, model)
    (behind,) = np.nonzero((ratio < 1.0) & (ratio > 0.0) & around)
    (missed,) = np.nonzero((ratio < 1.0 / CONFIDENT) & around)
    (near,) = np.nonzero((ratio > CONFIDENT) & around)
    at = np.concatenate([cluster, np.setdiff1d(behind, cluster)])
    image = window.azimuth, window.slope, window.distance
    azimuth, slope = window.azimuth[0, at], window.slope[0, at]
    reach = np.sqrt(1.0 + slope**2) / (w[0] * np.cos(azimuth) + w[1] * np.sin(azimuth) + w[2] * slope)
    row = np.zeros(window.azimuth.size, np.int64)

    def is_mixed(points: NDArray[np.int64]) -> Mask:
        return mixed_rays(*image, w, _OFF * model.sigma, _PULSE_M, row[points], points)

    is_below, has_return = up[at] < np.median(up[cluster]), np.ones(at.size, np.bool_)
    rays = EdgeRays(left[at], up[at], reach, ratio[at], is_below, is_mixed(at), has_return)
    returns = PlaneReturns(
        hits=hit_at,
        misses=np.stack([left[missed], up[missed], is_mixed(missed).astype(np.float64)]),
        near=np.stack([left[near], up[near], window.inside[0, near].astype(np.float64)]),
        inner=np.zeros((3, 0)),
    )
    width = float(np.ptp(left[cluster]))
    extent = PlaneExtent(0, 0, int(cluster.size), width, has_many_rings=cluster.size >= _MANY_POINTS)
    plane = Plane(window.R_window_lidar, w, covariance, np.zeros((3, 3)), score, rays, returns, extent)
    return PlaneCandidate(plane, window, np.array([[0, window.azimuth.size - 1]]))
