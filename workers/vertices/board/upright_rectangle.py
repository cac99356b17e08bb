"""The test of a board against the things that look most like one: signs, doors and other upright rectangles.

In the plane, with hard edges, the log likelihood of a rectangle is a sum over the rays inside it. With upper and
lower edges fixed, the likeliest left and right edges enclose the segment of rays with the largest sum (maximum
subarray). The two pairs of edges are found in turn (coordinate ascent).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.board_estimate import MOST_ON_BOARD, BoardEstimate
from workers.vertices.board.model import BoardModel
from workers.vertices.board.outline import on_board_probability
from workers.vertices.board.size import BLOOMING_RAD

Floats = NDArray[np.float64]
Ends = tuple[float, float]
_Segment = tuple[Floats, Floats, int, int]
_TURNS = 6
_STARTS = (1.0, 0.9, 0.5)
# A scene has some ten things that could be a board, and none may pass in 200 sweeps: log(2000).
_CLEAR = 7.6
# With level edges each of these ten is equally likely the board, before its size counts.
_ONE_OF_TEN = math.log(10.0)
# Of a board's returns 96 % lie within the middle of the rim about it, 99 % within its outer end.
_MOST, _NEARLY_ALL = 0.96, 0.99


def is_clearly_a_board(board: BoardEstimate, model: BoardModel) -> bool:
    """Return whether the board is so much likelier than any upright rectangle that its shape alone is enough."""
    return board.agreement.evidence - upright_evidence(board, model) > _CLEAR


def is_likelier_than_upright(board: BoardEstimate, model: BoardModel) -> bool:
    """Return whether the board explains the rays better than upright rectangles do.

    A lowered board is an upright rectangle. A sign looks like a board with level edges, but most of its returns are
    static.
    """
    if model.upper_corner and board.agreement.moving_share < MOST_ON_BOARD:
        return False
    if model.upper_corner and model.grid.scattered:
        # Without rings no ray shows where a larger rectangle ends, so the rectangle explains as much as the board.
        # The test is whether the returns end at the stated size.
        return rim_rad(board)[0] < BLOOMING_RAD[1]
    if model.upper_corner:
        return board.agreement.evidence + _inner_evidence(board, model) > upright_evidence(board, model) + _ONE_OF_TEN
    return board.agreement.evidence > upright_evidence(board, model)


def rim_rad(board: BoardEstimate) -> tuple[float, float]:
    """Return how far the returns reach beyond the board's edges, in radians.

    The first number holds for `_MOST` of the returns and all edges, the second for `_NEARLY_ALL` of them and the
    worse pair of edges.
    """
    mode = board.hold.likeliest
    x, y = board.plane.returns.hits - mode.mean[:2, None]
    cosine, sine = math.cos(mode.mean[2]), math.sin(mode.mean[2])
    along = np.stack([cosine * x - sine * y, sine * x + cosine * y])

    def beyond_edges(share: float) -> Floats:
        low, high = np.quantile(along, [0.5 - 0.5 * share, 0.5 + 0.5 * share], axis=1)
        beyond: Floats = ((high - low) / share - mode.edges) / (2.0 * float(np.median(board.plane.rays.reach)))
        return beyond

    return float(beyond_edges(_MOST).mean()), float(beyond_edges(_NEARLY_ALL).max())


def upright_evidence(board: BoardEstimate, model: BoardModel) -> float:
    """Return the log likelihood of the rays for an upright rectangle, its edges uniform over one metre each.

    A board with level edges is such a rectangle itself. It is compared with rectangles of any size, turned as it is.
    All returns in the plane count then: by the rays at the edges alone, a small rectangle on a part of the board that
    looks clean is likelier than the board.
    """
    rays = board.plane.rays
    gain = np.log(rays.contaminated_ratio(model))
    along = rays.left, rays.up
    if board.upper_corner:
        fall = board.hold.likeliest.mean[2]
        cosine, sine = math.cos(fall), math.sin(fall)
        left, up, ratio = board.plane.returns.inner
        left, up = np.concatenate([rays.left, left]), np.concatenate([rays.up, up])
        gain = np.concatenate([gain, np.log(ratio)])
        along = cosine * left - sine * up, -sine * left - cosine * up
    outside = -float(np.sum(np.maximum(gain, 0.0)))
    order = tuple(np.argsort(values, kind="stable") for values in along)
    best = max(_ascend(along, order, gain, first, share) for first in (0, 1) for share in _STARTS)
    return outside + best


def _inner_evidence(board: BoardEstimate, model: BoardModel) -> float:
    """Return the log likelihood of `PlaneReturns.inner` for the likeliest board, 0 if none lies clearly beside it.

    A ring along a level edge answers as a whole, so its returns count only beyond where the edge may answer.
    """
    left, up, ratio = board.plane.returns.inner
    mode = board.hold.likeliest
    reach = np.full_like(left, float(np.median(board.plane.rays.reach)))
    rim = reach * (model.blooming + 2.0 * model.softness)
    outline = (model.softness, model.slack, *mode.edges, np.concatenate([[0.0], mode.mean]))
    on_board = on_board_probability(left, up, rim, reach, *outline)
    return float(np.sum(np.log(1.0 + (ratio - 1.0) * on_board) - np.log(ratio)))


def _ascend(
    along: tuple[Floats, Floats], order: tuple[NDArray[np.int64], ...], gain: Floats, axis: int, share: float
) -> float:
    """Return the largest log likelihood that coordinate ascent reaches, along ``axis`` first.

    It begins between the edges along the other axis that enclose the middle ``share`` of the hits.
    """
    ends: list[Ends] = [(-math.inf, math.inf), (-math.inf, math.inf)]
    hits = along[1 - axis][gain > 0.0]
    if share < 1.0 and hits.size:
        low, high = np.quantile(hits, [0.5 - 0.5 * share, 0.5 + 0.5 * share]).tolist()
        ends[1 - axis] = (low, high)
    segments: list[_Segment | None] = [None, None]
    total = 0.0
    for turn in range(_TURNS):
        other = along[1 - axis]
        within = (other >= ends[1 - axis][0]) & (other <= ends[1 - axis][1])
        before = ends[axis]
        total, ends[axis], segments[axis] = _best_segment(
            along[axis][order[axis]], np.where(within, gain, 0.0)[order[axis]]
        )
        if turn > 1 and ends[axis] == before:
            break  # further turns end at the same edges
        axis = 1 - axis
    return total + sum(_log_end_width(*segment) for segment in segments if segment is not None)


def _best_segment(at: Floats, gain: Floats) -> tuple[float, Ends, _Segment]:
    """Return the largest sum of consecutive gains, its ends, and the arguments of `_log_end_width`.

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


def _log_end_width(at: Floats, before: Floats, first: int, last: int) -> float:
    """Return the log of the width in which an end of a segment may lie, over a metre, summed over both ends.

    Args:
        at: (N,) metres, rising; before: (N + 1,) sum of the gains of the rays before each.
        first, last: of the segment.
    """
    # An end between two rays may lie anywhere between them.
    gaps: Floats = np.diff(np.concatenate([[at[0] - 0.5], at, [at[-1] + 0.5]]))
    return _log_width(-before[: last + 1], gaps[: last + 1]) + _log_width(before[first:], gaps[first:])


def _log_width(log: Floats, width: Floats) -> float:
    return min(math.log(max(float(np.sum(np.exp(log - log.max()) * width)), 1e-6)), 0.0)
