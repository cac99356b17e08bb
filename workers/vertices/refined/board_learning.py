"""The board's edges where they are open, how beams meet them, and how people roll it: from boards of near sweeps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workers.vertices.refined.board import inside_of, locate, weigh
from workers.vertices.refined.board_model import EDGE_M, BoardModel, Floats, Plane, any_roll
from workers.vertices.refined.growth import (
    BEAM_SIGMA_RAD,
    GROWTH_RAD,
    SOFT_DEG,
    any_growth,
    likely_growth,
    usual_steps,
)
from workers.vertices.refined.holding import learn_roll
from workers.vertices.refined.plane_learning import ENOUGH
from workers.vertices.refined.rays import WRONG

_LENGTHS_M = (0.36 * 1.15 ** np.arange(10)).tolist()
_FIRST, _SOME = 5, 10
_HOPELESS = -300.0
_WIDE_ROLL = math.radians(12.0)  # the grid reaches 2.8 deviations: 34 degrees
_GROWTHS_RAD = (0.0, 1.0e-3, 2.0e-3, 4.0e-3, 8.0e-3)
_INSETS_RAD = (0.25e-3 * np.arange(1, 21)).tolist()  # beams are up to 10 mrad wide
_MOST_WRONG = 0.45  # from one half on, a return would speak for the other side of an edge


def learn_board(
    planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float], growth_mrad: float
) -> BoardModel:
    """The board's edges where they are not given, their growth, which edge is where, and the roll."""
    planes = no_taller(planes, edges)
    if len(planes) < ENOUGH:
        return model
    solid = [plane for plane in planes if plane.telling]
    enough = len(solid) >= ENOUGH
    steps = usual_steps()
    if not all(edges):
        model = _first_edges(planes, model, edges)
    elif enough and growth_mrad < 0.0:
        model = _first_growth(solid, model)
    for step in (1.0, 0.4):
        if enough and all(edges):
            model, steps = _learn_step(solid[:_SOME], model)
        model = _refine(planes, model, edges, growth_mrad, step, steps)
        if enough and all(edges):
            model = _learn_inset(solid[:_SOME], model)
        elif enough:
            model = _learn_blur(solid[:_SOME], model)
        if enough:
            model = _learn_wrong(solid[:_SOME], model)
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


def _first_edges(planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float]) -> BoardModel:
    """Of a coarse table of lengths those that explain the best seen boards best."""
    best = max(_table(model, edges), key=lambda candidate: evidence(planes[:_FIRST], candidate))
    return replace(best, slack=0.0)


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


def some_edges(planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float]) -> BoardModel:
    """What few boards tell of the edges: a mean over the table of lengths, each as likely as it explains them."""
    if not planes:
        return model
    tried = _table(model, edges)
    evidences = np.array([evidence(planes, candidate) for candidate in tried])
    weight = np.exp(evidences - np.logaddexp.reduce(evidences))
    lengths = np.array([candidate.edges for candidate in tried])
    mean = weight @ lengths
    spread = np.sqrt(weight @ (lengths - mean) ** 2)
    first, other = mean.tolist()
    half_step = 0.5 * (_LENGTHS_M[1] / _LENGTHS_M[0] - 1.0) * other
    slack = min(2.0 * float(spread.max()) + half_step, model.slack)
    return replace(model, edges=(first, other), slack=slack, sizes_tried=len(tried))


def _first_growth(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """Of a coarse table of growths and widths of the step at an edge those that explain the best seen boards best."""
    tried = [
        replace(model, growth=growth, inset=max(growth, BEAM_SIGMA_RAD), soft=math.radians(deg))
        for growth in _GROWTHS_RAD
        for deg in SOFT_DEG
    ]
    return max(tried, key=lambda candidate: evidence(planes[:_FIRST], candidate))


def _learn_blur(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """How gradually the hits end at an edge: what explains the near sweeps best."""
    widths = [replace(model, soft=math.radians(width)) for width in SOFT_DEG]
    return max(widths, key=lambda tried: evidence(planes, tried))


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


def _learn_wrong(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """Share of the returns at the edges on their wrong side; a hundred imagined ones at the default count too.

    At the lower edges body and hands answer, so they have a share of their own.
    """
    fixes = [fix for plane in planes if (fix := locate(plane, model, coarse=True)) is not None and fix.explained]
    above = _wrong([fix.upper for fix in fixes], model)
    return replace(model, wrong=above, wrong_below=max(_wrong([fix.lower for fix in fixes], model), above))


def _wrong(counts: Sequence[tuple[int, int]], model: BoardModel) -> float:
    against, rays = (sum(count[k] for count in counts) for k in (0, 1))
    default = BoardModel(model.grid).wrong
    return min(max((against + 100.0 * default) / (rays + 100.0), default), _MOST_WRONG)


def _learn_roll(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    wide = _any_way(model)
    fixes = [fix for plane in planes if (fix := locate(plane, wide)) is not None and fix.explained]
    if not fixes:
        return replace(model, roll=any_roll(model.edges), swapped=wide.swapped)
    holding = learn_roll(np.array([fix.told for fix in fixes]), any_roll(model.edges))
    return replace(model, roll=holding.roll, swapped=holding.swapped)


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
    return learn_roll(grids, any_roll(model.edges)).evidence + _HOPELESS * max(-few, 0)


def _refine(
    planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float], growth_mrad: float, step: float,
    widths: Floats,
) -> BoardModel:  # fmt: skip
    """Whatever is open of edge lengths and growth, by the evidence of the near sweeps, one after the other.

    A growth makes a board larger by twice the growth times its distance; so the lengths are varied as they appear at
    the planes' mean distance, which hardly depends on the growth. With the lengths open, only boards at several
    distances tell the growth, and each of them no better than to `EDGE_M`.
    """
    reach = mean_reach(planes)
    free = [index for index in (0, 1) if not all(edges) and model.edges[index] not in edges]
    state = np.array([*model.edges, model.growth])
    state[free] += 2.0 * reach * state[2]

    def modelled(x: Floats) -> BoardModel:
        lengths = [float(x[i] - 2.0 * reach * x[2] * (i in free)) for i in (0, 1)]
        return replace(model, edges=(lengths[0], lengths[1]), growth=float(x[2]))

    def explains(x: Floats) -> float:
        return evidence(planes, modelled(x))

    open_growth = growth_mrad < 0.0
    sigmas = np.zeros(3)
    steps = [0.02, 0.02, 0.5e-3]
    for index in [*free, *([2] if open_growth else [])]:
        state, sigmas[index] = _climb(explains, state, index, steps[index] * step)
    if open_growth:
        reaches = np.array([np.median(plane.reach) for plane in planes])
        lever = float(np.std(reaches) if free else np.mean(reaches)) * math.sqrt(len(planes))
        boards = state[2], math.hypot(sigmas[2], EDGE_M / max(lever, 1e-3))
        state[2], sigmas[2] = likely_growth(*boards, model.soft) if free else any_growth(*boards, widths)
    slack = 2.0 * float(max([sigmas[index] for index in free], default=0.0))
    return replace(modelled(state), slack=slack, growth_sigma=float(sigmas[2]))


def mean_reach(planes: Sequence[Plane]) -> float:
    """Metres, mean distance of planes."""
    return float(np.mean([np.median(plane.reach) for plane in planes]))


def _climb(value: Callable[[Floats], float], at: Floats, index: int, step: float) -> tuple[Floats, float]:
    """Along one coordinate in even steps to the highest value, then to the parabola's top; with its width."""

    def along(k: int) -> float:
        x = at.copy()
        x[index] += k * step
        return value(x)

    values: dict[int, float] = {k: along(k) for k in (-1, 0, 1)}
    for _ in range(8):
        top = max(values, key=values.__getitem__)
        missing = [k for k in (top - 1, top + 1) if k not in values]
        if not missing:
            break
        values |= {k: along(k) for k in missing}
    top = max(values, key=values.__getitem__)
    moved = at.copy()
    before, after = values.get(top - 1), values.get(top + 1)
    bend = 2.0 * values[top] - before - after if before is not None and after is not None else 0.0
    shift = 0.5 * (after - before) / bend if bend > 0.0 and before is not None and after is not None else 0.0
    moved[index] += (top + min(max(shift, -0.5), 0.5)) * step
    return moved, step / math.sqrt(bend) if bend > 1e-9 else step
