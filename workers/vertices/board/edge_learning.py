"""The board's edges where they are open, how beams meet them, and how people roll it: from boards of near sweeps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.estimate import inside_of, locate, weigh
from workers.vertices.board.holding import learn_roll
from workers.vertices.board.model import BEAM_M, EDGE_M, BoardModel, Contradictions, Floats, Plane, any_roll
from workers.vertices.board.plane_learning import ENOUGH
from workers.vertices.board.rays import WRONG
from workers.vertices.board.size import (
    BEAM_SIGMA_RAD,
    GROWTH_RAD,
    SOFT_DEG,
    SizeEstimate,
    any_growth,
    climb,
    usual_steps,
)
from workers.vertices.board.surroundings import likelier_than_upright

_LENGTHS_M = (0.36 * 1.15 ** np.arange(10)).tolist()
_SOME, _STARTS = 10, 2
_RANKING, _FEW, _MANY = 4, 8, 20  # boards that rank the table, climb first, and climb last
_LEAST_M = 0.1
_LEAST_GROWTH_RAD = 0.05e-3  # standard deviation, where the growth is stated
_HOPELESS = -300.0
_WIDE_ROLL = math.radians(12.0)  # the grid reaches 2.8 deviations: 34 degrees
_MOST_STRAY = 0.3  # between a quarter, which may be no boards, and one half, the smaller one of two ways
_INSETS_RAD = (0.25e-3 * np.arange(1, 21)).tolist()  # beams are up to 10 mrad wide
_MOST_WRONG = 0.45  # from one half on, a return would speak for the other side of an edge


def learn_board(planes: Sequence[Plane], model: BoardModel, is_growth_open: bool) -> BoardModel:
    """Return the model of a board with these edges: where they answer, which edge is where, and the roll."""
    with_bodies = [plane for plane in planes if plane.telling][:_SOME]
    planes = no_taller(planes, model.edges)
    if len(planes) < ENOUGH:
        return model
    solid = [plane for plane in planes if plane.telling]
    enough = len(solid) >= ENOUGH
    steps = usual_steps()
    for step in (1.0, 0.4):
        if enough:
            model, steps = _learn_step(solid[:_SOME], model)
        if is_growth_open:
            model = _learn_growth(planes, model, step, steps)
        if enough:
            model = learn_wrong(with_bodies, _learn_inset(solid[:_SOME], model))
        # Growth and roll are told by the same edges, so each is learned again with the other.
        model = _learn_roll(planes, model)
    return model


def no_taller(planes: Sequence[Plane], edges: tuple[float, float]) -> Sequence[Plane]:
    """The planes whose returns fit on the board, if its size is known; the others met a body, too."""
    if not all(edges):
        return planes
    most = math.hypot(*edges)
    fit = [
        p
        for p in planes
        if p.hits.size and np.ptp(p.hits[1]) < most + 2.0 * GROWTH_RAD[1] * float(np.median(p.reach))
    ]
    return fit if len(fit) >= ENOUGH else planes


def _table(model: BoardModel, edges: tuple[float, float]) -> list[BoardModel]:
    """The model with each pair of lengths of a coarse table."""
    longest = max(edges)
    lengths = [longest] if longest > 0.0 else _LENGTHS_M
    return [
        replace(model, edges=(length, other), slack=0.5 * (_LENGTHS_M[1] / _LENGTHS_M[0] - 1.0) * other)
        for length in lengths
        for other in _LENGTHS_M
        if longest > 0.0 or length <= other
    ]


def _learn_step(planes: Sequence[Plane], model: BoardModel) -> tuple[BoardModel, Floats]:
    """How gradually the hits end at an edge: the mean; and how likely each of the table's half widths is (K,)."""
    evidences = np.array([evidence(planes, replace(model, soft=math.radians(width))) for width in SOFT_DEG])
    share = usual_steps() * np.exp(evidences - evidences.max())
    share /= share.sum()
    return replace(model, soft=float(share @ np.radians(SOFT_DEG))), share


def _learn_inset(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """How far inside of an edge a beam still meets what is behind it.

    Up to there some share of the returns is mixed, and farther inside only those that are wrong. Which depth parts
    two such shares best is told by the returns on boards that are found, and by data sheets.
    """
    parts = [
        inside_of(plane, model, fix)
        for plane in planes
        if (fix := locate(plane, model, coarse=True)) is not None and fix.explained
    ]
    depth, mixed = (np.concatenate([np.zeros(0), *(part[k] for part in parts)]) for k in (0, 1))

    def likely(inset: float) -> float:
        usual = -0.5 * ((inset - BEAM_SIGMA_RAD) / BEAM_SIGMA_RAD) ** 2
        return usual + _parted(depth < inset, mixed > 0.0)

    return replace(model, inset=max(_INSETS_RAD, key=likely))


def _parted(shallow: NDArray[np.bool_], mixed: NDArray[np.bool_]) -> float:
    """Log likelihood that returns are mixed, where the shallow ones and the others have a share each."""
    total = 0.0
    for part in (mixed[shallow], mixed[~shallow]):
        share = (np.count_nonzero(part) + WRONG) / (part.size + 2.0 * WRONG)
        total += np.count_nonzero(part) * math.log(share) + np.count_nonzero(~part) * math.log1p(-share)
    return total


def learn_wrong(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """Share of the returns at the edges on their wrong side; a hundred imagined ones at the default count too.

    At the lower edges body and hands answer, so they have a share of their own, from all that are boards above.
    """
    fixes = [fix for plane in planes if (fix := locate(plane, model, coarse=True)) is not None]
    boards = [fix for fix in fixes if fix.explained_above and likelier_than_upright(fix, model)]
    above, below = (_wrong([fix.at_edges[part] for fix in boards], model) for part in (0, 1))
    return replace(model, wrong=above, wrong_below=max(below, above))


def _wrong(parts: Sequence[Contradictions], model: BoardModel) -> float:
    against, rays = (sum(part[k] for part in parts) for k in (0, 1))
    default = BoardModel(model.grid).wrong
    return min(max((against + 100.0 * default) / (rays + 100.0), default), _MOST_WRONG)


def _learn_roll(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    wide = _any_way(model)
    fixes = [fix for plane in planes if (fix := locate(plane, wide)) is not None and fix.explained]
    if not fixes:
        return replace(model, roll=any_roll(model.edges, model.upper_corner), swapped=wide.swapped)
    holding = learn_roll(np.array([fix.told for fix in fixes]), any_roll(model.edges, model.upper_corner))
    # Where each hand has an angle of its own, no mean is usual: each board's rays tell its roll.
    return replace(model, roll=wide.roll if holding.stray > _MOST_STRAY else holding.roll, swapped=holding.swapped)


def _any_way(model: BoardModel) -> BoardModel:
    """The model with so wide a prior on the roll that the fit reaches every roll which the rays allow."""
    return replace(model, roll=(0.0, _WIDE_ROLL), swapped=BoardModel(model.grid).swapped)


def evidence(planes: Sequence[Plane], model: BoardModel) -> float:
    """Log evidence of a model over three quarters of the sweeps: those that it explains worst may be no boards.

    The boards' rolls have an unknown mean in common: each by itself can take the roll that suits a wrong model.
    """
    wide = _any_way(model)
    weighed = [weigh(plane, wide, coarse=True) for plane in planes]
    boards = sorted((board for board in weighed if board is not None), key=lambda board: board.evidence)
    few = len(weighed) // 4 - (len(weighed) - len(boards))
    counted = boards[max(few, 0) :]
    if not counted:
        return _HOPELESS * len(weighed)
    grids = np.array([board.told for board in counted])
    return learn_roll(grids, any_roll(model.edges, model.upper_corner)).evidence + _HOPELESS * max(-few, 0)


def _fit_edges(
    planes: Sequence[Plane], model: BoardModel, free: Sequence[int], step: float
) -> tuple[Floats, Floats, float]:
    """Return the optimum (3,) of edge lengths (m) and growth (rad), its covariance (3, 3), and the evidence there.

    A growth makes a board larger by twice the growth times its distance; so the lengths are varied as they appear at
    the planes' mean distance, which hardly depends on the growth. With the lengths open, only boards at several
    distances tell the growth.

    Args:
        free: which of these numbers are open.
    """
    towards = np.eye(3)
    towards[[axis for axis in free if axis < 2], 2] = -2.0 * _mean_reach(planes)

    def explains(x: Floats) -> float:
        first, other, growth = (towards @ x).tolist()
        lengths = max(first, _LEAST_M), max(other, _LEAST_M)
        # A growth is even over `GROWTH_RAD`; a normal prior as wide keeps it there where no board tells it.
        unusual = (growth - sum(GROWTH_RAD) / 2.0) / (GROWTH_RAD[1] - GROWTH_RAD[0])
        return evidence(planes, replace(model, edges=lengths, growth=growth, slack=0.0)) - 2.0 * unusual**2

    start: Floats = np.asarray(np.linalg.solve(towards, [*model.edges, model.growth]), np.float64)
    optimum, inverse, highest = climb(explains, start, free, step * np.array([0.02, 0.02, 1.0e-3]))
    return towards @ optimum, towards @ inverse @ towards.T, highest


def learn_size(
    planes: Sequence[Plane],
    model: BoardModel,
    edges: tuple[float, float],
    is_growth_open: bool,
    stated: tuple[float, float] | None = None,
) -> tuple[BoardModel, SizeEstimate]:
    """Return the model with the open edges and the growth that all boards together show, and their estimate.

    The climb starts at the stated size, and at the best of a table that explain the boards better.

    A beam on an edge and a body behind it returns from between them: as far inside of the edge as the widest beams
    reach, such returns tell neither size nor growth.
    """
    solid = [plane for plane in planes if plane.telling][:_SOME]
    fitted = replace(model, inset=_INSETS_RAD[-1])
    planes, few, ranking = (planes[:: -(-len(planes) // count)] for count in (_MANY, _FEW, _RANKING))
    starts = sorted(_table(fitted, edges), key=lambda start: -evidence(ranking, start))[:_STARTS]
    open_edges = [index for index in (0, 1) if starts[0].edges[index] not in edges]
    fits = []
    if stated is not None:
        fits = [_fit_edges(few, replace(fitted, edges=stated, slack=0.0), open_edges, 1.0)]
        first, other, _ = fits[0][0].tolist()
        near = evidence(ranking, replace(fitted, edges=(first, other), slack=0.0))
        starts = [start for start in starts if evidence(ranking, start) > near]
    fits += [_fit_edges(few, start, open_edges, 1.0) for start in starts]
    free = [*open_edges, *([2] if is_growth_open else [])]
    for step, counted in ((1.0, few), (0.4, planes)):
        best, covariance, _ = max(fits, key=lambda fit: fit[2])
        fitted = replace(fitted, edges=(float(best[0]), float(best[1])), growth=float(best[2]), slack=0.0)
        if step < 1.0 and len(solid) >= ENOUGH:
            fitted = learn_wrong(solid, _learn_step(solid, fitted)[0])
        fits = [_fit_edges(counted, fitted, free, step)]
    best, covariance, _ = fits[0]
    fixed = covariance - np.outer(covariance[2], covariance[2]) / max(covariance[2, 2], 1e-12)
    # The cut and the place where beams answer are the same on all boards.
    spread = covariance + np.diag([EDGE_M**2 + BEAM_M**2, EDGE_M**2 + BEAM_M**2, _LEAST_GROWTH_RAD**2])
    if is_growth_open:
        # Hands and bends move each board's edges by `EDGE_M`, so boards tell the growth by their lever only.
        lever = max(float(np.std([np.median(plane.reach) for plane in planes])) * math.sqrt(len(planes)), 1e-3)
        towards = np.array([-2.0 * _mean_reach(planes) * (axis in free) for axis in (0, 1)] + [1.0])
        spread += (EDGE_M / lever) ** 2 * np.outer(towards, towards)
    size = SizeEstimate(best, spread)
    (first, other, growth), usual = size.usual()
    model = replace(fitted, inset=model.inset, edges=(float(first), float(other)), growth=float(growth))
    slack, sigma = 2.0 * np.sqrt(np.diag(fixed)[:2].clip(0.0).max()), math.sqrt(usual[2, 2]) * is_growth_open
    return replace(model, slack=float(slack), growth_sigma=sigma), size


def _learn_growth(planes: Sequence[Plane], model: BoardModel, step: float, widths: Floats) -> BoardModel:
    """Return the model with the growth that the near sweeps tell of a board of known size."""
    best, covariance, _ = _fit_edges(planes, model, [2], step)
    sigma = math.hypot(math.sqrt(covariance[2, 2]), EDGE_M / (_mean_reach(planes) * math.sqrt(len(planes))))
    growth, sigma = any_growth(float(best[2]), sigma, widths)
    return replace(model, growth=growth, growth_sigma=sigma)


def first_growth(planes: Sequence[Plane], model: BoardModel, open_size: BoardModel) -> BoardModel:
    """Return the model with the growth that makes its board look as large as that of ``open_size``."""
    growth = open_size.growth + (sum(open_size.edges) - sum(model.edges)) / (4.0 * _mean_reach(planes))
    growth = min(max(growth, GROWTH_RAD[0]), GROWTH_RAD[1])
    return replace(model, growth=growth, inset=max(growth, BEAM_SIGMA_RAD), soft=open_size.soft)


def _mean_reach(planes: Sequence[Plane]) -> float:
    """Metres, mean distance of planes."""
    return float(np.mean([np.median(plane.reach) for plane in planes]))
