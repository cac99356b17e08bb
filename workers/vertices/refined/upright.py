"""How well an upright rectangle, as a sign, a door or a lowered board, explains the rays that a board explains.

In the plane, with hard edges, the log likelihood of a rectangle is a sum over the rays inside it. With upper and
lower edges fixed, the likeliest left and right edges are the ends of the stretch of rays with the largest sum. The
two pairs of edges are found in turn.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from workers.vertices.refined.board_model import BoardModel, Fix

Floats = NDArray[np.float64]
Ends = tuple[float, float]
_Stretch = tuple[Floats, Floats, int, int]
_TURNS = 6
_STARTS = (1.0, 0.9, 0.5)
# A scene has some ten things that could be a board, and none may pass in 200 sweeps: log(2000).
_CLEAR = 7.6
_CHOSEN_CONTRADICTED = 0.125  # half of what may contradict a board of known size on two or three rings


def clearly_a_board(fix: Fix, model: BoardModel) -> bool:
    """Whether the board is so much likelier than every upright rectangle that its shape alone is enough.

    One of many sizes fits also what is no board: better by the logarithm of their number, and with fewer returns that
    contradict it.
    """
    if model.sizes_tried > 1 and fix.against > _CHOSEN_CONTRADICTED * (fix.plane.points + fix.against):
        return False
    return fix.evidence - upright_evidence(fix, model) > _CLEAR + math.log(model.sizes_tried)


def likelier_than_upright(fix: Fix, model: BoardModel) -> bool:
    """Whether the board explains the rays better than upright rectangles do, one of which a lowered board is."""
    return fix.evidence > upright_evidence(fix, model)


def upright_evidence(fix: Fix, model: BoardModel) -> float:
    """Log of the rays' likelihood for an upright rectangle, averaged over its edges: each is even over one metre."""
    plane = fix.plane
    gain = np.log(plane.believed(model))
    outside = -float(np.sum(np.maximum(gain, 0.0)))
    along = plane.left, plane.up
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
