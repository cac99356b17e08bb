"""One sweep's board: the planes that could be it, and the apex that the rays tell for the best of them."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.refined.board_model import (
    BEAM_M,
    EDGE_M,
    ROLLS,
    TELLING_RINGS,
    BoardModel,
    Fix,
    Floats,
    Plane,
    Sighting,
    Way,
    hang,
)
from workers.vertices.refined.clusters import clusters
from workers.vertices.refined.corner import integrate
from workers.vertices.refined.planes import find_stretches, grow_plane, pair_stretches
from workers.vertices.refined.rays import choose_rays, follow_board, likelihood_ratios
from workers.vertices.refined.window import Window, open_window
from workers.vertices.sensor_grid import SensorGrid

_WIDEST_M = 1.8  # a stretch of points on a ring that is wider is no board
_NARROWEST_M = 0.26
_PAIRS = 8
_ON_BOARD = 2.0  # likelihood ratio from which a point counts as the board's
_CONFIDENT = 5.0
_UNLIKELY = 0.05
_HOPELESS = 12.0  # log odds from which the other way to hold the board is not followed further
_COARSE, _FINE = 24, 36  # cells along either side of the grid
_ROLLS = 9
_ROLL_STEP = math.radians(0.9)  # of the prior's standard deviation for each roll of the first pass
# Pulses last 4 to 6 ns; echoes that are less than c t / 2 apart become one.
_PULSE_M = 0.9
_OFF = 4.0  # standard deviations behind the plane: the return is not of the board alone
_ASTRAY_M = 0.12  # hits that are not the board's lie this far beside it at most
_ROLL_REACH = 2.8  # standard deviations of the prior that the first pass covers


def open_windows(sweep: Sweep, inside: NDArray[np.bool_], grid: SensorGrid) -> list[Window]:
    """A window around every group of points that lie in the region."""
    return [
        open_window(sweep, inside, grid, centre, half + 5.0 * float(grid.steps.max()))
        for centre, half in clusters(sweep.xyz[inside])
    ]


def find_planes(windows: Iterable[Window], model: BoardModel, most: int) -> list[Sighting]:
    """Planes that could be the board's, at least two rings on each, the likeliest first."""
    found: list[tuple[float, Window, Floats, Floats, tuple[int, int, int]]] = []
    prior = np.array([*model.yaw, *model.tilt])
    for window in windows:
        stretches = find_stretches(window.azimuth, window.distance, window.inside, model.sigma, window.steps)
        pairs = pair_stretches(stretches, window.slope, _WIDEST_M, _PAIRS)
        ring, column = np.nonzero(window.inside)
        azimuth, slope, distance = (part[ring, column] for part in (window.azimuth, window.slope, window.distance))
        seen: list[Floats] = []
        for pair in pairs:
            start = np.zeros(ring.size, np.bool_)
            for r, first, last in stretches[pair, :3].astype(np.int64):
                start |= (ring == r) & (column >= first) & (column <= last)
            r, first, last = stretches[pair[0], :3].astype(int).tolist()
            for downwards in (True, False):
                w, info, score = grow_plane(azimuth, slope, distance, start, downwards, model.sigma, prior)
                if not any(bool(np.all(np.abs(other - w) < 0.003 * abs(w[0]))) for other in seen):
                    seen.append(w)
                    spread: Floats = np.asarray(np.linalg.inv(info), np.float64)
                    found.append((score, window, w, spread, (r, first, last)))
    found.sort(key=lambda item: -item[0])
    sightings: list[Sighting] = []
    for item in found:
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
    score: float, window: Window, w: Floats, spread: Floats, seed: tuple[int, int, int], model: BoardModel
) -> Sighting | None:
    left, up, ratio = likelihood_ratios(
        window.azimuth, window.slope, window.distance, w, spread, model.sigma, model.lost
    )
    ends = follow_board(left, up, ratio, window.inside, *seed)
    on_board = np.flatnonzero(ends[:, 0] >= 0)
    if on_board.size < 2:
        return None
    at = tuple(choose_rays(left, up, ratio, window.distance, ends).T)
    u = w[0] * np.cos(window.azimuth[at]) + w[1] * np.sin(window.azimuth[at]) + w[2] * window.slope[at]
    column: NDArray[np.int64] = np.arange(int(ratio.shape[1]))
    between: NDArray[np.bool_] = (column >= ends[:, :1]) & (column <= ends[:, 1:]) & (ends[:, :1] >= 0)
    points = int(np.count_nonzero(between & (ratio > _ON_BOARD)))
    hits = np.nonzero(between & (ratio > _CONFIDENT))
    # Rings so far apart that a board holds fewer of them have met a body too.
    apart = float(np.median(np.diff(window.slope[on_board, window.slope.shape[1] // 2])) / np.median(u))
    reach = np.sqrt(1.0 + window.slope[at] ** 2) / u
    widths = (1 + ends[on_board, 1] - ends[on_board, 0]) * window.steps[on_board]
    widest = int(on_board[np.argmax(widths)])
    level = float(up[widest, ends[widest].sum() // 2])
    plane = Plane(
        R_window_lidar=window.R_window_lidar,
        w=w,
        spread=spread,
        score=score,
        left=left[at],
        up=up[at],
        reach=reach,
        ratio=ratio[at],
        below=up[at] < level,
        mixed=_mixed(window, w, at, model.sigma),
        hits=np.stack([left[hits], up[hits]]),
        rings=int(on_board.size),
        top_ring=int(window.ring[on_board[-1]]),
        points=points,
        width=(float(widths.max()) - 2.0 * model.growth) * float(np.median(reach)),
        returned=window.distance[at] > 0.0,
        telling=on_board.size >= TELLING_RINGS and (TELLING_RINGS - 1) * apart < math.hypot(*model.edges),
    )
    return Sighting(plane, window, ends)


def _mixed(window: Window, w: Floats, at: tuple[NDArray[np.int64], ...], sigma: float) -> NDArray[np.bool_]:
    """Which rays may have met both the board and something close behind it.

    Of a dark body and a part of the board together often nothing comes back. So a ray without a return is one of
    them, if a ray next to it has a return from close behind.
    """

    def close_behind(ring: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.bool_]:
        azimuth, slope, distance = (part[ring, column] for part in (window.azimuth, window.slope, window.distance))
        u = w[0] * np.cos(azimuth) + w[1] * np.sin(azimuth) + w[2] * slope
        behind = np.sqrt(1.0 + slope**2) * (distance - 1.0 / u)
        found: NDArray[np.bool_] = (u > 0.0) & (distance > 0.0) & (behind > _OFF * sigma) & (behind < _PULSE_M)
        return found

    mixed = close_behind(*at)
    silent = np.flatnonzero(window.distance[at] <= 0.0)
    ring, column = (part[silent] for part in at)
    rings, columns = window.distance.shape
    for up in (-1, 0, 1):
        for left in (-1, 0, 1):
            beside = np.clip(ring + up, 0, rings - 1), np.clip(column + left, 0, columns - 1)
            mixed[silent] |= close_behind(*beside)
    return mixed


def locate(plane: Plane, model: BoardModel, *, coarse: bool = False) -> Fix | None:
    """The apex in a plane, over both ways to hold the board; None where no board explains the rays.

    Args:
        coarse: for comparing models: quicker, and good enough for the evidence.
    """
    found: list[tuple[float, bool, Floats, Floats, Floats]] = []
    for share, swapped in sorted([(1.0 - model.swapped, False), (model.swapped, True)], reverse=True):
        floor = found[0][0] - math.log(share) - _HOPELESS if found else -math.inf
        corner = _corner(plane, model, _edges(model, swapped), coarse, floor)
        if corner is not None:
            found.append((math.log(share) + float(corner[0][0]), swapped, *corner))
    if not found:
        return None
    evidence = np.array([item[0] for item in found])
    total = float(np.logaddexp.reduce(evidence))
    weight = np.exp(evidence - total)
    means = np.array([[*corner[1:3], corner[3] - hang(_edges(model, swapped))] for _, swapped, corner, *_ in found])
    mean: Floats = weight @ means
    covariance = np.zeros((3, 3))
    for x, m, (_, _, corner, *_) in zip(weight, means, found, strict=True):
        covariance += x * (_matrix(corner) + np.outer(m - mean, m - mean))
    own = _to_angles(plane, mean, covariance)[1]
    covariance[[0, 1], [0, 1]] += EDGE_M**2 + BEAM_M**2
    xyz, errors = _to_angles(plane, mean, covariance)
    errors[2, 2] += model.bias**2  # what all rings have in common is of the size by which they differ
    errors[2, 2] = max(errors[2, 2], EDGE_M**2)  # boards bend by as much as their edges are off
    # Both edges move out, so the apex rises by the square root of two.
    rises = _rising(plane, xyz)
    errors += 2.0 * model.growth_sigma**2 * np.outer(rises, rises)
    told = np.full((2, ROLLS.size), -math.inf)
    for _, swapped, _, likely, rolls in found:
        told[int(swapped)] = np.interp(
            ROLLS, rolls - hang(_edges(model, swapped)), likely, left=-math.inf, right=-math.inf
        )
    first = int(np.argmax(weight))
    against, upper, lower = _against(plane, model, _edges(model, found[first][1]), found[first][2])
    wrong = np.where(plane.below, model.wrong_below, model.wrong)
    expected = float(np.sum(wrong * np.log(wrong))) + plane.ratio.size * model.lost * math.log(model.lost)
    best = max(float(corner[10]) for _, _, corner, *_ in found)
    roll_sigma = math.sqrt(max(float(covariance[2, 2]), 1e-12))
    fall = float(sum(x * corner[3] for x, (_, _, corner, *_) in zip(weight, found, strict=True)))
    sigma = math.sqrt(own[0, 0] + own[1, 1])
    ways = tuple(
        Way(float(x), _edges(model, swapped), corner[1:4], _matrix(corner))
        for x, (_, swapped, corner, *_) in zip(weight, found, strict=True)
    )
    return Fix(
        plane, xyz, errors, sigma, float(mean[2]), roll_sigma, fall, against, upper, lower, best, expected, total,
        model.wrong, told, ways,
    )  # fmt: skip


def _edges(model: BoardModel, swapped: bool) -> tuple[float, float]:
    """Lengths of the edges to the lower left and to the lower right."""
    one, other = model.edges
    return (other, one) if swapped else (one, other)


def _against(
    plane: Plane, model: BoardModel, edges: tuple[float, float], corner: Floats
) -> tuple[int, tuple[int, int], tuple[int, int]]:
    """`Fix.against`, `Fix.upper` and `Fix.lower` of the board in the middle of its posterior."""
    on_board = _covered(plane.left, plane.up, _grown(plane, model), plane.reach, model, edges, corner)
    hit, missed = plane.ratio > _CONFIDENT, plane.returned & (plane.ratio < 1.0 / _CONFIDENT)
    # Near a soft edge either answer is as expected.
    inside, outside = missed & (on_board > 1.0 - _UNLIKELY), hit & (on_board < _UNLIKELY)
    side = corner[2] - min(edges[0] * math.sin(corner[3]), edges[1] * math.cos(corner[3]))
    contrary = inside | outside
    upper, lower = (
        (int(np.count_nonzero(contrary & part)), int(np.count_nonzero(plane.returned & part)))
        for part in (plane.up > side, plane.up <= side)
    )
    # A wall is met far beside the board too, not only at the ends of its stretches.
    left, up = plane.hits[0], plane.hits[1]
    reach = np.full_like(left, float(np.median(plane.reach)))
    beside = _covered(left, up, reach * model.growth, reach, model, edges, corner)
    return int(np.count_nonzero(inside)) + int(np.count_nonzero(beside < _UNLIKELY)), upper, lower


def _grown(plane: Plane, model: BoardModel) -> Floats:
    """(N,) metres by which the edges seem to lie farther out at each ray.

    A beam that meets the edge and something close behind it gives one return between the two, which is off the plane.
    So such returns begin as far inside of the edge as other beams reach outside. On few rings they count as misses:
    there a head's returns above the board tell where its apex is.
    """
    sign = np.where(plane.mixed & plane.telling, -1.0, 1.0)
    return plane.reach * model.growth * sign


def _covered(
    left: Floats,
    up: Floats,
    grow: Floats,
    reach: Floats,
    model: BoardModel,
    edges: tuple[float, float],
    corner: Floats,
) -> Floats:
    """(N,) probability that rays which meet the plane there lie on the board in the middle of its posterior."""
    p, q = _turns(corner[3:4])[0] @ np.array([left - corner[1], up - corner[2]])
    soft = reach * model.soft
    far = np.hypot(soft, model.slack)
    on_board = np.ones(p.size)
    for along, edge in ((p, edges[0]), (q, edges[1])):
        on_board *= _smooth((along + grow) / soft) * _smooth((edge + grow - along) / far)
    return on_board


def _smooth(x: Floats) -> Floats:
    t = np.clip(0.5 * x + 0.5, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _matrix(corner: Floats) -> Floats:
    ll, uu, rr, lu, lr, ur = corner[4:10]
    return np.array([[ll, lu, lr], [lu, uu, ur], [lr, ur, rr]])


def _corner(
    plane: Plane, model: BoardModel, edges: tuple[float, float], coarse: bool, floor: float
) -> tuple[Floats, Floats, Floats] | None:
    """Three passes of :func:`integrate`, each over the part of the grid where the one before found the posterior.

    Returns:
        Its moments, and of the last pass the log evidence (K,) of each roll and the rolls (K,). None where no board
        explains the rays, or the first pass ends below ``floor``.
    """
    hits = plane.ratio > _CONFIDENT
    if not hits.any():
        return None
    mean, sigma = hang(edges) + model.roll[0], model.roll[1]
    ratio = plane.believed(model)
    rolls = _even(mean - _ROLL_REACH * sigma, mean + _ROLL_REACH * sigma, max(_ROLLS, 1 + round(sigma / _ROLL_STEP)))
    grow, soft = _grown(plane, model), plane.reach * model.soft
    turns = _turns(rolls)
    # Of each roll: the apexes whose board holds all hits.
    along = turns @ np.array([plane.left, plane.up])[:, hits]
    low, high = along.max(axis=2) - np.array(edges), along.min(axis=2)
    centre, half = 0.5 * (low + high), 0.5 * np.abs(high - low) + _ASTRAY_M + model.slack
    origin = np.zeros(2)
    out, of_roll = np.zeros(0), np.zeros(0)
    passes = (20, 24) if coarse else (_COARSE, _COARSE, _FINE)
    for number, cells in enumerate(passes):
        if number > 0:
            reach = 3.0 * max(math.sqrt(max(out[6], 1e-8)), 0.35 * (rolls[1] - rolls[0]))
            ends = max(out[3] - reach, mean - 3.2 * sigma), min(out[3] + reach, mean + 3.2 * sigma)
            after = _even(*ends, _ROLLS + 2 if cells == _FINE else _ROLLS)
            apex = (turns @ of_roll[:, 1:3, None])[..., 0] + origin
            own = 3.2 * of_roll[:, 3:5] + 2.0 * half / passes[number - 1]
            seen = of_roll[:, 0] > -1e299
            turns, origin = _turns(after), out[1:3].copy()
            about = _interpolated(after, rolls[seen], apex[seen]) - origin
            centre, half = (turns @ about[..., None])[..., 0], _interpolated(after, rolls[seen], own[seen])
            rolls = after
        prior = -0.5 * ((rolls - mean) / sigma) ** 2 + math.log(
            (rolls[1] - rolls[0]) / sigma / math.sqrt(2.0 * math.pi)
        )
        out, of_roll = integrate(
            plane.left - origin[0], plane.up - origin[1], grow, soft, ratio,
            edges[0], edges[1], model.slack, rolls, prior, centre, half, cells,
        )  # fmt: skip
        if out[0] < max(floor if number == 0 else -math.inf, -1e299):
            return None
        out[1:3] += origin
    return out, of_roll[:, 0], rolls


def _interpolated(at: Floats, x: Floats, values: Floats) -> Floats:
    """(K, 2) at ``at`` (K,) of ``values`` (J, 2) at ``x`` (J,)."""
    return np.column_stack([np.interp(at, x, values[:, k]) for k in (0, 1)])


def _even(low: float, high: float, count: int) -> Floats:
    return low + (high - low) * np.arange(count, dtype=np.float64) / (count - 1)


def _turns(rolls: Floats) -> Floats:
    """(K, 2, 2) from (left, up) to the coordinates along the edges to the lower left and lower right, or back."""
    cosine, sine = np.cos(rolls), np.sin(rolls)
    return np.moveaxis(np.array([[cosine, -sine], [-sine, -cosine]]), 2, 0)


def _to_angles(plane: Plane, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """The apex in the LiDAR frame, and its covariance over azimuth, elevation and range."""
    w = plane.w
    norm = float(np.linalg.norm(w))
    n = w / norm
    e_left = np.array([-n[1], n[0], 0.0]) / math.hypot(n[0], n[1])
    e_up = np.cross(n, e_left)
    apex = n / norm + mean[0] * e_left + mean[1] * e_up
    flat, reach = math.hypot(apex[0], apex[1]), float(np.linalg.norm(apex))
    xyz = plane.R_window_lidar.T @ apex
    jacobian = _sphere(xyz) @ plane.R_window_lidar.T @ np.array([e_left, e_up]).T
    errors = jacobian @ covariance[:2, :2] @ jacobian.T
    ray = apex / flat
    errors[2, 2] += float(ray @ plane.spread @ ray) * flat**4 * (reach / flat) ** 2
    return xyz, errors


def _sphere(xyz: Floats) -> Floats:
    """(3, 3) derivatives of azimuth, elevation and range by x, y, z."""
    x, y, z = xyz.tolist()
    flat, reach = math.hypot(x, y), math.sqrt(x * x + y * y + z * z)
    azimuth = np.array([-y, x, 0.0]) / flat**2
    elevation = np.array([-x * z / flat, -y * z / flat, flat]) / reach**2
    return np.array([azimuth, elevation, xyz / reach])


def _rising(plane: Plane, xyz: Floats) -> Floats:
    """(3,) what azimuth, elevation and range change by where the apex rises by a radian of its distance."""
    x, y, z = (plane.R_window_lidar @ xyz).tolist()
    flat = math.hypot(x, y)
    up: Floats = np.array([-x * z / flat, -y * z / flat, flat])
    return _sphere(xyz) @ plane.R_window_lidar.T @ up


def find_boards(
    sweep: Sweep, inside: NDArray[np.bool_], model: BoardModel, most: int = 5
) -> list[tuple[Sighting, Fix]]:
    """The apexes that the likeliest planes of a sweep tell: boards by all appearances first, then the likeliest."""
    sightings = find_planes(open_windows(sweep, inside, model.grid), model, most)
    found = [(sighting, fix) for sighting in sightings if (fix := locate(sighting.plane, model)) is not None]
    return sorted(found, key=lambda pair: (not pair[1].explained, -pair[1].support))
