"""Whether a board looks as large as it was said to be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from workers.vertices.refined.board import locate
from workers.vertices.refined.board_model import BEAM_M, EDGE_M, TRUNK_M, BoardModel, Plane
from workers.vertices.vertex import SizeFacts

Edges = tuple[float, float]
_TELLING: Final = 2  # boards on four rings or more; any one may be a board and a body
_HIDDEN: Final = 0.03  # of the edges; smaller errors do not show (`_DIFFERS`)
_CONTRADICT: Final = 0.01  # of a board's returns; five times as many as a sensor gets wrong
# Two edges, each to either side: 4 * 0.0013 = 0.5 % of the sizes that are right.
_DIFFERS: Final = 3.0
_GROWTH_SIGMA_RAD: Final = 0.5e-3


def doubtful(planes: Sequence[Plane], model: BoardModel, reach: float) -> bool:
    """Whether what was learned may hide that the given size is wrong, or contradicts it.

    If a board is larger than it was said to be, its edges seem to lie farther out; if it is smaller, the step at its
    edges seems to be wide, or rays contradict it. Otherwise the size is right. Learning it anew would tell nothing,
    and takes as long as all other learning. On two or three rings legs and bodies look like a part of the board, so
    boards on these alone tell no size. A beam reaches outside of an edge by at most half of its width (`inset`). So a
    growth between zero and the inset is no sign of another size.

    Args:
        reach: metres, mean distance of the boards.
    """
    if sum(plane.telling for plane in planes) < _TELLING:
        return False
    if (
        model.inset is not None
        and -model.growth_sigma < model.growth < model.inset
        and model.soft < 2.0 * model.inset
    ):
        return False
    if 2.0 * reach * max(abs(model.growth), model.soft) > _HIDDEN * 0.5 * sum(model.edges):
        return True
    if model.growth > 0.0:
        # The edges fit: what contradicts is a head or hands.
        return False
    fixes = [(locate(plane, model, coarse=True), plane.points) for plane in planes]
    return float(np.median([1.0 if fix is None else fix.against / points for fix, points in fixes])) > _CONTRADICT


def other_size(edges: Edges, learned: BoardModel, reach: float) -> SizeFacts | None:
    """The size of a board whose edges are not those ``edges``; None if they may be.

    Args:
        learned: what was learned with the size open.
        reach: metres, mean distance of the boards.
    """
    sigma = math.sqrt(
        (0.5 * learned.slack) ** 2 + (2.0 * reach * learned.growth_sigma) ** 2 + 2.0 * (EDGE_M**2 + BEAM_M**2)
    )
    (short, long), stated = sorted(learned.edges), sorted(edges)
    if short < TRUNK_M:
        return None
    if max(abs(short - stated[0]), abs(long - stated[1])) < _DIFFERS * sigma:
        return None
    return SizeFacts((short, long), (sigma, sigma))


def growth_spread(soft: float) -> float:
    """Radians, standard deviation of the growth about the step's half width ``soft``, before boards tell."""
    return math.hypot(_GROWTH_SIGMA_RAD, 0.5 * soft)
