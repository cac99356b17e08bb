"""From a board in its plane to what is stated of it: the apex in the LiDAR's axes, its time, and what is around.

How well an upright rectangle, as a sign, a door or a lowered board, explains the rays that a board explains: in the
plane, with hard edges, the log likelihood of a rectangle is a sum over the rays inside it. With upper and lower edges
fixed, the likeliest left and right edges are the ends of the stretch of rays with the largest sum. The two pairs of
edges are found in turn. A sweep without a vertex says what its likeliest candidate looks like.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.board.model import MOST_ON_BOARD, BoardModel, Fix, Sighting
from workers.vertices.board.posterior import step
from workers.vertices.board.size import GROWTH_RAD

Floats = NDArray[np.float64]


@nb.njit(nogil=True, cache=True, error_model="numpy")
def to_angles(R_window_lidar: Floats, w: Floats, spread: Floats, at: Floats) -> tuple[Floats, Floats, float, Floats]:
    """A place in a plane, in the LiDAR frame.

    Args:
        w: (3,) the plane, in the window's frame; spread: (3, 3) its covariance.
        at: (2,) metres to the left and up.

    Returns:
        xyz (3,); (3, 2) derivatives of azimuth, elevation and range by ``at``; the variance of the range that the
        plane leaves open; (3,) what azimuth, elevation and range change by where the place rises by a radian of its
        distance.
    """
    norm = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    n = w / norm
    flat = math.hypot(n[0], n[1])
    # e_left = z x n, e_up = n x e_left
    axes = np.zeros((3, 3))
    axes[0, 0], axes[1, 0] = -n[1] / flat, n[0] / flat
    axes[0, 1], axes[1, 1], axes[2, 1] = -n[2] * axes[1, 0], n[2] * axes[0, 0], flat
    apex = n / norm + at[0] * axes[:, 0] + at[1] * axes[:, 1]
    x, y, z = apex
    reach = math.sqrt(x * x + y * y + z * z)
    flat = math.hypot(x, y)
    axes[:, 2] = np.array([-x * z / flat, -y * z / flat, flat])
    variance = 0.0
    for i in range(3):
        for j in range(3):
            variance += apex[i] * spread[i, j] * apex[j]
    variance *= reach * reach
    turned = np.zeros((3, 3))
    xyz = np.zeros(3)
    for i in range(3):
        for j in range(3):
            xyz[i] += R_window_lidar[j, i] * apex[j]
            for k in range(3):
                turned[i, k] += R_window_lidar[j, i] * axes[j, k]
    x, y, z = xyz
    flat = math.hypot(x, y)
    moved = np.empty((3, 3))
    for k in range(3):
        a, b, c = turned[:, k]
        moved[0, k] = (x * b - y * a) / flat**2
        moved[1, k] = (flat * c - (x * a + y * b) * z / flat) / reach**2
        moved[2, k] = (x * a + y * b + z * c) / reach
    return xyz, moved[:, :2].copy(), variance, moved[:, 2].copy()


@nb.njit(nogil=True, cache=True, error_model="numpy")
def covered(
    left: Floats, up: Floats, grow: Floats, reach: Floats, soft: float, slack: float,
    edge_p: float, edge_q: float, corner: Floats,
) -> Floats:  # fmt: skip
    """(N,) probability that rays which meet the plane there lie on the board in the middle of its posterior.

    Args:
        left, up: (N,) metres; grow: (N,) metres by which the edges seem to lie farther out.
        reach: (N,) metres; soft: radians, half width of the step at an edge.
        slack: metres, half width of what is not known of the edges' lengths edge_p and edge_q.
        corner: moments as of `corner.integrate`.
    """
    cosine, sine = math.cos(corner[3]), math.sin(corner[3])
    on_board = np.empty(left.size)
    for i in range(left.size):
        x, y = left[i] - corner[1], up[i] - corner[2]
        p, q = cosine * x - sine * y, -sine * x - cosine * y
        near = reach[i] * soft
        far = math.hypot(near, slack)
        on_board[i] = step((p + grow[i]) / near) * step((edge_p + grow[i] - p) / far)
        on_board[i] *= step((q + grow[i]) / near) * step((edge_q + grow[i] - q) / far)
    return on_board


_HEAD_BESIDE_M = 0.35
_HEAD_BEHIND_M = (-0.15, 0.7)
_IN_FRONT_M = 0.15
_BOARD_BESIDE_M, _BOARD_ABOVE_M, _BOARD_BEFORE_M, _BOARD_POINTS = 0.5, 1.5, -0.8, 2
_OCCLUDED_RINGS = 0.25
# Spinning sensors' data sheets state ranges to 0.03 m, and to 0.1 m where a return is unusually strong or weak.
_ACCURACY_M = 0.1
_EDGES = 2.0


def apex_time(sweep: Sweep, sighting: Sighting, fix: Fix) -> int:
    """Nanoseconds after the sweep's stamp at which the sensor looked along the apex's azimuth."""
    window, ends = sighting.window, sighting.ends
    runs = [(r, slice(first, last + 1)) for r, (first, last) in enumerate(ends.tolist()) if first >= 0]
    point = np.concatenate([window.point[run] for run in runs])
    azimuth = np.concatenate([window.azimuth[run] for run in runs])[point >= 0]
    offset = sweep.offset_ns[point[point >= 0]].astype(np.float64)
    apex = window.R_window_lidar @ fix.xyz
    towards = math.atan2(apex[1], apex[0])
    away = azimuth - azimuth.mean()
    spread = float(away @ away)
    rate = float(away @ offset) / spread if spread > 0.0 else 0.0
    return round(float(offset.mean()) + rate * (towards - float(azimuth.mean())))


def flags_of(sighting: Sighting, fix: Fix) -> tuple[str, ...]:
    """Names in ``vertex.FLAGS`` of what the person who confirms should look at."""
    behind, left, up = _around_apex(sighting, fix)
    returned = sighting.window.distance > 0.0
    over = returned & sighting.window.inside & (up > 0.0) & (np.abs(left) < _HEAD_BESIDE_M)
    over &= (behind > _HEAD_BEHIND_M[0]) & (behind < _HEAD_BEHIND_M[1])
    head = bool(over.any())
    hidden, rings = 0, 0
    for r, (first, last) in enumerate(sighting.ends.tolist()):
        if first >= 0:
            rings += 1
            beside = [c for c in (first - 1, first - 2, last + 1, last + 2) if 0 <= c < behind.shape[1]]
            hidden += any(returned[r, c] and behind[r, c] < -_IN_FRONT_M for c in beside)
    occluded = hidden > _OCCLUDED_RINGS * rings
    return (*(["head_above"] if head else []), *(["occluded"] if occluded else []))


def overtopped(sighting: Sighting, fix: Fix, model: BoardModel) -> bool:
    """Whether something stands above the apex and before the plane: then the plane is the body's, below a board."""
    behind, left, up = _around_apex(sighting, fix)
    over = (sighting.window.distance > 0.0) & sighting.window.inside & (np.abs(left) < _BOARD_BESIDE_M)
    # The beams that graze the board's own edges return from above its apex, and from before its plane.
    beside = _EDGES * (model.growth + model.soft) * sighting.plane.reach.mean()
    over &= (up > beside) & (up < _BOARD_ABOVE_M)
    # On a few rings the plane may be the body's, close behind a board: nothing but the noise can be allowed for.
    unusual = _ACCURACY_M if sighting.plane.telling else 0.0
    over &= (behind > _BOARD_BEFORE_M) & (behind < -unusual - 4.0 * model.sigma)
    return int(np.count_nonzero(over)) >= _BOARD_POINTS


def _around_apex(sighting: Sighting, fix: Fix) -> tuple[Floats, Floats, Floats]:
    """(R, C) metres: how far each return lies behind the plane, and how far its ray left of and above the apex."""
    window, w = sighting.window, sighting.plane.w
    inverse = w[0] * np.cos(window.azimuth) + w[1] * np.sin(window.azimuth) + w[2] * window.slope
    distance = 1.0 / np.maximum(inverse, 1e-3)
    apex = window.R_window_lidar @ fix.xyz
    left = distance * np.sin(window.azimuth - math.atan2(apex[1], apex[0]))
    return window.distance - distance, left, distance * window.slope - apex[2]


Floats = NDArray[np.float64]
Ends = tuple[float, float]
_Stretch = tuple[Floats, Floats, int, int]
_TURNS = 6
_STARTS = (1.0, 0.9, 0.5)
# A scene has some ten things that could be a board, and none may pass in 200 sweeps: log(2000).
_CLEAR = 7.6
# With level edges each of these ten is as likely the board, before its size tells it.
_ONE_OF_TEN = math.log(10.0)
_MOST, _NEARLY_ALL = 0.96, 0.99  # of a board's returns: to the middle and to the end of the rim about it


def clearly_a_board(fix: Fix, model: BoardModel) -> bool:
    """Whether the board is so much likelier than every upright rectangle that its shape alone is enough."""
    return fix.evidence - upright_evidence(fix, model) > _CLEAR


def likelier_than_upright(fix: Fix, model: BoardModel) -> bool:
    """Whether the board explains the rays better than upright rectangles do, one of which a lowered board is.

    With level edges a sign is such a board, too, but most of its returns are static.
    """
    if model.upper_corner and fix.moving < MOST_ON_BOARD:
        return False
    if model.upper_corner and model.grid.scattered:
        # No ray tells that a larger rectangle ends, so it holds all that a board does: returns must end as stated.
        return rim(fix)[0] < GROWTH_RAD[1]
    return fix.evidence > upright_evidence(fix, model) + (_ONE_OF_TEN if model.upper_corner else 0.0)


def rim(fix: Fix) -> tuple[float, float]:
    """Radians by which most of a board's returns reach beyond its edges, and nearly all beyond the worse two."""
    way = max(fix.ways, key=lambda way: way.weight)
    x, y = fix.plane.hits - way.mean[:2, None]
    cosine, sine = math.cos(way.mean[2]), math.sin(way.mean[2])
    along = np.stack([cosine * x - sine * y, sine * x + cosine * y])

    def grown(share: float) -> Floats:
        low, high = np.quantile(along, [0.5 - 0.5 * share, 0.5 + 0.5 * share], axis=1)
        beyond: Floats = ((high - low) / share - way.edges) / (2.0 * float(np.median(fix.plane.reach)))
        return beyond

    return float(grown(_MOST).mean()), float(grown(_NEARLY_ALL).max())


def upright_evidence(fix: Fix, model: BoardModel) -> float:
    """Log of the rays' likelihood for an upright rectangle, averaged over its edges: each is even over one metre.

    A board with level edges is such a rectangle: then the other ones are turned as it is, and have any size.
    """
    plane = fix.plane
    gain = np.log(plane.believed(model))
    outside = -float(np.sum(np.maximum(gain, 0.0)))
    along = plane.left, plane.up
    if fix.upper_corner:
        fall = max(fix.ways, key=lambda way: way.weight).mean[2]
        cosine, sine = math.cos(fall), math.sin(fall)
        along = cosine * plane.left - sine * plane.up, -sine * plane.left - cosine * plane.up
    order = tuple(np.argsort(values, kind="stable") for values in along)
    best = max(_climb(along, order, gain, first, share) for first in (0, 1) for share in _STARTS)
    return outside + best


def _climb(
    along: tuple[Floats, Floats], order: tuple[NDArray[np.int64], ...], gain: Floats, axis: int, share: float
) -> float:
    """The largest log likelihood: along ``axis`` first, then along both axes in turn.

    It begins with the stretch along the other axis that holds this share of the hits, in the middle.
    """
    ends: list[Ends] = [(-math.inf, math.inf), (-math.inf, math.inf)]
    hits = along[1 - axis][gain > 0.0]
    if share < 1.0 and hits.size:
        low, high = np.quantile(hits, [0.5 - 0.5 * share, 0.5 + 0.5 * share]).tolist()
        ends[1 - axis] = (low, high)
    stretches: list[_Stretch | None] = [None, None]
    total = 0.0
    for turn in range(_TURNS):
        other = along[1 - axis]
        within = (other >= ends[1 - axis][0]) & (other <= ends[1 - axis][1])
        before = ends[axis]
        total, ends[axis], stretches[axis] = _stretch(
            along[axis][order[axis]], np.where(within, gain, 0.0)[order[axis]]
        )
        if turn > 1 and ends[axis] == before:
            break  # all further turns find the same
        axis = 1 - axis
    return total + sum(_kept_ends(*stretch) for stretch in stretches if stretch is not None)


def _stretch(at: Floats, gain: Floats) -> tuple[float, Ends, _Stretch]:
    """Largest sum of consecutive gains, its ends, and what tells how certain they are (`_kept_ends`).

    Args:
        at: (N,) metres, rising; gain: (N,) log likelihood ratio of the ray there.
    """
    before = np.zeros(gain.size + 1)
    np.cumsum(gain, out=before[1:])
    lowest = np.minimum.accumulate(before)
    last = int(np.argmax(before - lowest))
    first = int(np.argmin(before[: last + 1]))
    total = float(before[last] - before[first])
    ends = float(at[min(first, at.size - 1)]), float(at[max(last - 1, 0)])
    return total, ends, (at, before, first, last)


def _kept_ends(at: Floats, before: Floats, first: int, last: int) -> float:
    """A log for both ends of a stretch: of the part of a metre where each may lie.

    Args:
        at: (N,) metres, rising; before: (N + 1,) sum of the gains of the rays before each.
    """
    # An end between two rays is anywhere between them.
    gaps: Floats = np.diff(np.concatenate([[at[0] - 0.5], at, [at[-1] + 0.5]]))
    return _kept(-before[: last + 1], gaps[: last + 1]) + _kept(before[first:], gaps[first:])


def _kept(log: Floats, width: Floats) -> float:
    return min(math.log(max(float(np.sum(np.exp(log - log.max()) * width)), 1e-6)), 0.0)


def thing(fix: Fix) -> str:
    """Return what a candidate looks like."""
    plane = fix.plane
    high = float(np.ptp(plane.hits[1])) if plane.hits.size else 0.0
    on = f"on {plane.rings} rings" if plane.rings else f"with {plane.points} returns"
    return (
        f"a flat thing of {max(plane.width, 0.0):.1f} x {high:.1f} m at {float(np.linalg.norm(fix.xyz)):.1f} m {on}"
    )


def no_board(fix: Fix, model: BoardModel, least_points: int) -> str:
    """Return the first thing of a candidate that a board does not do, with its number."""
    plane = fix.plane
    board = f"a board of {model.edges[0]:.2f} x {model.edges[1]:.2f} m"
    turned, leant = (math.degrees(math.atan(abs(slope))) for slope in (plane.w[1:] / plane.w[0]).tolist())
    off_upright = math.degrees(min(fix.fall % (0.5 * math.pi), -fix.fall % (0.5 * math.pi)))
    if not plane.held or leant > 35.0 or turned > 60.0:
        why = (
            f"leaning {leant:.0f} degrees: boards lean up to 35"
            if leant > 35.0
            else f"turned by {turned:.0f} degrees from the sensor: boards are turned by up to 60"
        )
    elif not fix.held:
        on_tip = "boards stand on their tip, unless --corner says otherwise"
        usual = "boards with level edges have upright ones" if model.upper_corner else on_tip
        why = f"with edges {off_upright:.0f} degrees from upright: {usual}"
    elif fix.within < MOST_ON_BOARD:
        why = f"of whose returns {fix.within:.0%} lie on {board}"
    elif not fix.explained:
        why = f"where {fix.against} of {plane.points + fix.against} returns contradict {board}"
    elif plane.points < least_points:
        why = f"with {plane.points} returns: a board has {least_points} at least"
    else:
        why = f"leaning {leant:.0f} degrees, as likely clutter as {board}"
    return why
