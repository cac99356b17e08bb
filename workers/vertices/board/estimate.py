"""One sweep's board: the planes that could be it, and the apex that the rays tell for the best of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.board.model import (
    BEAM_M,
    EDGE_M,
    ROLLS,
    BoardModel,
    Contradictions,
    Fix,
    Floats,
    Plane,
    Sighting,
    Way,
)
from workers.vertices.board.posterior import find_corner
from workers.vertices.board.sightings import CONFIDENT, find_planes, open_windows
from workers.vertices.board.surroundings import covered, to_angles

_UNLIKELY = 0.05
_HOPELESS = 12.0  # log odds from which the other way to hold the board is not followed further


def locate(plane: Plane, model: BoardModel, *, coarse: bool = False) -> Fix | None:
    """The apex in a plane, over both ways to hold the board; None where no board explains the rays.

    Args:
        coarse: see :func:`weigh`.
    """
    weighed = weigh(plane, model, coarse=coarse)
    if weighed is None:
        return None
    corners = [way.corner for way in weighed.ways]
    weight = np.exp(np.array([way.evidence for way in weighed.ways]) - weighed.evidence)
    means = np.array([[*way.corner[1:3], way.corner[3] - model.rest_angle(way.edges)] for way in weighed.ways])
    mean: Floats = weight @ means
    apart = means - mean
    covariance = np.einsum("w,wij->ij", weight, [_matrix(corner) for corner in corners]) + (apart.T * weight) @ apart
    xyz, J, along, rises = to_angles(plane.R_window_lidar, plane.w, plane.spread + plane.uneven, mean[:2])
    own = J @ covariance[:2, :2] @ J.T
    errors = own + (EDGE_M**2 + BEAM_M**2) * (J @ J.T)
    # What all rings have in common is of the size by which they differ.
    errors[2, 2] += along + model.bias**2
    errors[2, 2] = max(errors[2, 2], EDGE_M**2)  # boards bend by as much as their edges are off
    # Both edges move out, so the tip rises by the square root of two, and an upper corner goes up and aside as far.
    if model.upper_corner:
        out: Floats = float(np.linalg.norm(xyz)) * J @ np.array([model.upper_corner, 1.0])
        errors += model.growth_sigma**2 * np.outer(out, out)
    else:
        errors += 2.0 * model.growth_sigma**2 * np.outer(rises, rises)
    first = int(np.argmax(weight))
    returns, within, at_edges = _count_contradictions(plane, model, weighed.ways[first].edges, corners[first])
    moving = _moving(plane, model, weighed.ways[first].edges, corners[first]) if model.upper_corner else 1.0
    wrong = np.where(plane.below, model.wrong_below, model.wrong)
    expected = float(np.sum(wrong * np.log(wrong))) + plane.ratio.size * model.lost * math.log(model.lost)
    ways = tuple(
        Way(x, way.edges, way.corner[1:4], _matrix(way.corner))
        for x, way in zip(weight.tolist(), weighed.ways, strict=True)
    )
    return Fix(
        plane, xyz, errors, math.sqrt(own[0, 0] + own[1, 1]), float(mean[2]),
        math.sqrt(max(float(covariance[2, 2]), 1e-12)), float(weight @ np.array([corner[3] for corner in corners])),
        returns, within, at_edges, max(float(corner[10]) for corner in corners), expected, weighed.evidence,
        (model.wrong, model.wrong_below), weighed.told, ways, model.upper_corner, moving,
    )  # fmt: skip


class _Way(NamedTuple):
    """A way to hold the board: its edges, the log of its share of the evidence, its moments as of `find_corner`."""

    edges: tuple[float, float]
    evidence: float
    corner: Floats


class Held(NamedTuple):
    """What a plane's rays tell of each way to hold the board; see `Fix` for ``evidence`` and ``told``."""

    ways: tuple[_Way, ...]
    evidence: float
    told: Floats


def weigh(plane: Plane, model: BoardModel, *, coarse: bool = False) -> Held | None:
    """Both ways to hold the board in a plane; None where no board explains the rays.

    Args:
        coarse: for comparing models: quicker, and good enough for the evidence.
    """
    ways: list[_Way] = []
    grid = np.full((2, ROLLS.size), -math.inf)
    for share, swapped in sorted([(1.0 - model.swapped, False), (model.swapped, True)], reverse=True):
        floor = ways[0].evidence - math.log(share) - _HOPELESS if ways else -math.inf
        edges = _edges(model, swapped)
        best = _corner(plane, model, edges, coarse, floor)
        if best is not None:
            corner, likely, rolls = best
            ways.append(_Way(edges, math.log(share) + float(corner[0]), corner))
            grid[int(swapped)] = np.interp(
                ROLLS, rolls - model.rest_angle(edges), likely, left=-math.inf, right=-math.inf
            )
    if not ways:
        return None
    return Held(tuple(ways), float(np.logaddexp.reduce([way.evidence for way in ways])), grid)


def _edges(model: BoardModel, swapped: bool) -> tuple[float, float]:
    """Lengths of the edges to the lower left and to the lower right."""
    first, other = model.edges
    return (other, first) if swapped else (first, other)


def _count_contradictions(
    plane: Plane, model: BoardModel, edges: tuple[float, float], corner: Floats
) -> tuple[tuple[Contradictions, Contradictions], float, tuple[Contradictions, Contradictions]]:
    """`Fix.returns`, `Fix.within` and `Fix.at_edges` of the board in the middle of its posterior."""
    board = (model.soft, model.slack, *edges, corner)
    down = edges[0] * math.sin(corner[3]), edges[1] * math.cos(corner[3])
    side = corner[2] - (sum(down) if model.upper_corner else min(down))
    on_board = covered(plane.left, plane.up, _grown(plane, model), plane.reach, *board)
    hit, missed = plane.ratio > CONFIDENT, plane.returned & (plane.ratio < 1.0 / CONFIDENT)
    # Near a soft edge either answer is as expected.
    contrary = (missed & (on_board > 1.0 - _UNLIKELY)) | (hit & (on_board < _UNLIKELY))
    at_edges = _above_and_below(plane.up[contrary] - side, plane.up[plane.returned] - side)
    # A wall is met far beside the board too, not only at the ends of its stretches.
    left, up = plane.hits[0], plane.hits[1]
    middle = float(np.median(plane.reach))
    reach = np.full_like(left, middle)
    beside = covered(left, up, reach * model.growth, reach, *board) < _UNLIKELY
    within = covered(left, up, np.zeros_like(left), reach, *board)
    # Behind a board nothing is seen, also where no ray was chosen.
    left, low, mixed = plane.misses
    reach = np.full_like(left, middle)
    through = covered(left, low, _growth(mixed > 0.0, plane, model) * middle, reach, *board) > 1.0 - _UNLIKELY
    returns = _above_and_below(np.concatenate([up[beside], low[through]]) - side, up - side)
    return returns, float(within.mean()) if within.size else 0.0, at_edges


def _above_and_below(against_m: Floats, returns_m: Floats) -> tuple[Contradictions, Contradictions]:
    """Count above and below the side corners; heights from these, metres."""
    above, all_above = int(np.count_nonzero(against_m > 0.0)), int(np.count_nonzero(returns_m > 0.0))
    return Contradictions(above, all_above), Contradictions(against_m.size - above, returns_m.size - all_above)


def _moving(plane: Plane, model: BoardModel, edges: tuple[float, float], corner: Floats) -> float:
    """`Fix.moving` of the board in the middle of its posterior."""
    left, up, moves = plane.near
    reach = np.full_like(left, float(np.median(plane.reach)))
    on_board = covered(left, up, np.zeros_like(left), reach, model.soft, model.slack, *edges, corner)
    return float(on_board @ moves) / max(float(on_board.sum()), 1.0)


def inside_of(plane: Plane, model: BoardModel, fix: Fix) -> tuple[Floats, Floats]:
    """Of the returns that meet a board that was found: radians to its nearest edge, and 1 where they are mixed."""
    way = max(fix.ways, key=lambda way: way.weight)
    mixed = plane.mixed & plane.returned & (plane.ratio < 1.0 / CONFIDENT)
    reach = np.concatenate([plane.reach[mixed], np.full(plane.hits.shape[1], float(np.median(plane.reach)))])
    x = np.concatenate([plane.left[mixed], plane.hits[0]]) - way.mean[0]
    y = np.concatenate([plane.up[mixed], plane.hits[1]]) - way.mean[1]
    cosine, sine = math.cos(way.mean[2]), math.sin(way.mean[2])
    p, q = cosine * x - sine * y, -sine * x - cosine * y
    depth = np.minimum(np.minimum(p, way.edges[0] - p), np.minimum(q, way.edges[1] - q)) / reach
    on_board = depth > 0.0
    return depth[on_board], np.repeat([1.0, 0.0], [np.count_nonzero(mixed), plane.hits.shape[1]])[on_board]


def _grown(plane: Plane, model: BoardModel) -> Floats:
    """(N,) metres by which the edges seem to lie farther out at each ray.

    A beam that meets the edge and something close behind it gives one return between the two, which is off the plane.
    So such returns begin inside of the edge, as far as beams reach (`BoardModel.inset`), and at least as far as other
    beams reach outside. Where that was not learned, they begin just so far, and on few rings they count as misses.
    """
    return plane.reach * _growth(plane.mixed, plane, model)


def _growth(mixed: NDArray[np.bool_], plane: Plane, model: BoardModel) -> Floats:
    """Radians of `_grown`, negative where edges seem to lie farther in, for rays of which (N,) bool mixed is told."""
    if model.inset is not None:
        return np.where(mixed, -max(model.inset, model.growth), model.growth)
    return np.where(mixed & plane.telling, -model.growth, model.growth)


def _matrix(corner: Floats) -> Floats:
    ll, uu, rr, lu, lr, ur = corner[4:10]
    return np.array([[ll, lu, lr], [lu, uu, ur], [lr, ur, rr]])


def _corner(
    plane: Plane, model: BoardModel, edges: tuple[float, float], coarse: bool, floor: float
) -> tuple[Floats, Floats, Floats] | None:
    """See :func:`find_corner`. None where no board explains the rays, or the first pass ends below ``floor``."""
    hits = plane.ratio > CONFIDENT
    if not hits.any():
        return None
    best = find_corner(
        plane.left, plane.up, _grown(plane, model), plane.reach * model.soft, plane.believed(model), hits,
        edges[0], edges[1], model.slack, model.rest_angle(edges) + model.roll[0], model.roll[1], coarse, floor,
    )  # fmt: skip
    return best if best[0][0] > -1e299 else None


def find_boards(
    sweep: Sweep, inside: NDArray[np.bool_], model: BoardModel, most: int = 5
) -> list[tuple[Sighting, Fix]]:
    """The apexes that the likeliest planes of a sweep tell: boards by all appearances first, then the likeliest."""
    sightings = find_planes(open_windows(sweep, inside, model.grid), model, most)
    boards = [(sighting, fix) for sighting in sightings if (fix := locate(sighting.plane, model)) is not None]
    return sorted(boards, key=lambda pair: (not pair[1].explained, -pair[1].support))
