"""The board's size, where its edges answer, and how people roll it: learned from the boards of near sweeps.

Each unknown is chosen by the evidence of all boards together: the likelihood of their rays, averaged over where and
how each is held. Size and blooming are climbed to by Newton's method; softness and inset are compared on a table; and
roll, blooming and contradictions are learned in turn, because the same edges show them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from workers.vertices.board.board_estimate import Contradictions
from workers.vertices.board.candidate import Plane
from workers.vertices.board.estimate import board_posterior, depths_inside_edges, estimate_board
from workers.vertices.board.holding import learn_roll
from workers.vertices.board.model import BEAM_M, EDGE_M, BoardModel, Floats, any_roll
from workers.vertices.board.plane_learning import ENOUGH
from workers.vertices.board.rays import WRONG
from workers.vertices.board.size import (
    BEAM_SIGMA_RAD,
    BLOOMING_RAD,
    SOFT_DEG,
    SizeEstimate,
    climb,
    usual_blooming,
    usual_softness,
)
from workers.vertices.board.upright_rectangle import is_likelier_than_upright

_LENGTHS_M = (0.36 * 1.15 ** np.arange(10)).tolist()
_SOME, _STARTS = 10, 2
_RANKING, _FEW, _MANY = 4, 8, 20  # boards that rank the table, climb first, and climb last
_LEAST_M = 0.1
_LEAST_BLOOMING_RAD = 0.05e-3  # standard deviation, if the blooming is stated
_HOPELESS = -300.0
_WIDE_ROLL = math.radians(12.0)  # the grid reaches 2.8 deviations: 34 degrees
_MOST_STRAY = 0.3  # between a quarter, which may be no boards, and one half, which two hands share
_INSETS_RAD = (0.25e-3 * np.arange(1, 21)).tolist()  # beams are up to 10 mrad wide
_MOST_WRONG = 0.45  # from one half on, a return would speak for the other side of an edge


def learn_board(planes: Sequence[Plane], model: BoardModel, is_blooming_open: bool) -> BoardModel:
    """Return the model with all that boards of its edges show: where edges answer, contradictions, and the roll."""
    with_bodies = [plane for plane in planes if plane.extent.has_many_rings][:_SOME]
    planes = fitting_on_board(planes, model.edges)
    if len(planes) < ENOUGH:
        return model
    solid = [plane for plane in planes if plane.extent.has_many_rings]
    enough = len(solid) >= ENOUGH
    widths = usual_softness()
    for step in (1.0, 0.4):
        if enough:
            model, widths = _learn_softness(solid[:_SOME], model)
        if is_blooming_open:
            model = _learn_blooming(planes, model, step, widths)
        if enough:
            model = learn_wrong(with_bodies, _learn_inset(solid[:_SOME], model))
        # The same edges show blooming and roll, so each is learned again with the other.
        model = _learn_roll(planes, model)
    return model


def fitting_on_board(planes: Sequence[Plane], edges: tuple[float, float]) -> Sequence[Plane]:
    """Return the planes whose returns fit on the board, if its size is known; the others met a body, too."""
    if not all(edges):
        return planes
    most = math.hypot(*edges)
    fit = [
        p
        for p in planes
        if p.returns.hits.size
        and np.ptp(p.returns.hits[1]) < most + 2.0 * BLOOMING_RAD[1] * float(np.median(p.rays.reach))
    ]
    return fit if len(fit) >= ENOUGH else planes


def _table(model: BoardModel, edges: tuple[float, float]) -> list[BoardModel]:
    """Return the model with each pair of lengths of a coarse table."""
    longest = max(edges)
    lengths = [longest] if longest > 0.0 else _LENGTHS_M
    return [
        replace(model, edges=(length, other), slack=0.5 * (_LENGTHS_M[1] / _LENGTHS_M[0] - 1.0) * other)
        for length in lengths
        for other in _LENGTHS_M
        if longest > 0.0 or length <= other
    ]


def _learn_softness(planes: Sequence[Plane], model: BoardModel) -> tuple[BoardModel, Floats]:
    """Return the model with the mean softness of the edges, and the share (K,) of each half width of the table."""
    evidences = np.array([evidence(planes, replace(model, softness=math.radians(width))) for width in SOFT_DEG])
    share = usual_softness() * np.exp(evidences - evidences.max())
    share /= share.sum()
    return replace(model, softness=float(share @ np.radians(SOFT_DEG))), share


def _learn_inset(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """Return the model with its inset: how far inside an edge a beam still returns what is behind it.

    Up to the inset a larger share of returns is mixed, and farther inside only the wrong ones are. The depth that
    best separates two such shares is chosen, by returns on estimated boards and by data sheets.
    """
    parts = [
        depths_inside_edges(board)
        for plane in planes
        if (board := estimate_board(plane, model, coarse=True)) is not None and board.is_consistent
    ]
    depth, mixed = (np.concatenate([np.zeros(0), *(part[k] for part in parts)]) for k in (0, 1))

    def log_posterior(inset: float) -> float:
        usual = -0.5 * ((inset - BEAM_SIGMA_RAD) / BEAM_SIGMA_RAD) ** 2
        return usual + _split_likelihood(depth < inset, mixed > 0.0)

    return replace(model, inset=max(_INSETS_RAD, key=log_posterior))


def _split_likelihood(shallow: NDArray[np.bool_], mixed: NDArray[np.bool_]) -> float:
    """Return the log likelihood of which returns are mixed, if shallow ones have one share and the others another."""
    total = 0.0
    for part in (mixed[shallow], mixed[~shallow]):
        share = (np.count_nonzero(part) + WRONG) / (part.size + 2.0 * WRONG)
        total += np.count_nonzero(part) * math.log(share) + np.count_nonzero(~part) * math.log1p(-share)
    return total


def learn_wrong(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """Return the model with the shares of returns on the wrong side of the edges, above and below the side corners.

    A hundred imagined returns at the default count, too. Body and hands answer at the lower edges, so these have a
    share of their own, from all candidates that are boards above.
    """
    estimates = [board for plane in planes if (board := estimate_board(plane, model, coarse=True)) is not None]
    boards = [board for board in estimates if board.is_consistent_above and is_likelier_than_upright(board, model)]
    above, below = (_wrong_share([board.agreement.at_edges[part] for board in boards], model) for part in (0, 1))
    return replace(model, wrong=above, wrong_below=max(below, above))


def _wrong_share(parts: Sequence[Contradictions], model: BoardModel) -> float:
    contradicting, rays = (sum(part[k] for part in parts) for k in (0, 1))
    default = BoardModel(model.grid).wrong
    return min(max((contradicting + 100.0 * default) / (rays + 100.0), default), _MOST_WRONG)


def _learn_roll(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """Return the model with the roll and the share of swapped edges that all boards together show."""
    wide = _with_any_roll(model)
    estimates = [
        board for plane in planes if (board := estimate_board(plane, wide)) is not None and board.is_consistent
    ]
    if not estimates:
        return replace(model, roll=any_roll(model.edges, model.upper_corner), swapped=wide.swapped)
    holding = learn_roll(
        np.array([board.hold.roll_log_likelihood for board in estimates]),
        any_roll(model.edges, model.upper_corner),
    )
    # If each hand has an angle of its own, no mean is usual: each board's rays alone determine its roll.
    return replace(model, roll=wide.roll if holding.stray > _MOST_STRAY else holding.roll, swapped=holding.swapped)


def _with_any_roll(model: BoardModel) -> BoardModel:
    """Return the model with so wide a prior on the roll that the fit reaches every roll that the rays allow."""
    return replace(model, roll=(0.0, _WIDE_ROLL), swapped=BoardModel(model.grid).swapped)


def evidence(planes: Sequence[Plane], model: BoardModel) -> float:
    """Return the log evidence of a model over the three quarters of the sweeps that it explains best.

    The others may be no boards. All boards share an unknown mean roll: each by itself could take the roll that suits
    a wrong model.
    """
    wide = _with_any_roll(model)
    posteriors = [board_posterior(plane, wide, coarse=True) for plane in planes]
    boards = sorted((board for board in posteriors if board is not None), key=lambda board: board.evidence)
    few = len(posteriors) // 4 - (len(posteriors) - len(boards))
    counted = boards[max(few, 0) :]
    if not counted:
        return _HOPELESS * len(posteriors)
    grids = np.array([board.roll_log_likelihood for board in counted])
    return learn_roll(grids, any_roll(model.edges, model.upper_corner)).evidence + _HOPELESS * max(-few, 0)


def _fit_edges(
    planes: Sequence[Plane], model: BoardModel, free: Sequence[int], step: float
) -> tuple[Floats, Floats, float]:
    """Return the optimum (3,) of edge lengths (m) and blooming (rad), its covariance (3, 3), and the evidence there.

    Blooming makes a board larger by twice the blooming times its distance. So the lengths are varied as they appear
    at the planes' mean distance, which hardly depends on the blooming. If the lengths are open, only boards at
    several distances show the blooming.

    Args:
        free: indices of the numbers that are open.
    """
    towards = np.eye(3)
    towards[[axis for axis in free if axis < 2], 2] = -2.0 * _mean_reach(planes)

    def log_evidence(x: Floats) -> float:
        first, other, blooming = (towards @ x).tolist()
        lengths = max(first, _LEAST_M), max(other, _LEAST_M)
        # Blooming is uniform over `BLOOMING_RAD`; a normal prior as wide keeps it there if no board shows it.
        unusual = (blooming - sum(BLOOMING_RAD) / 2.0) / (BLOOMING_RAD[1] - BLOOMING_RAD[0])
        return evidence(planes, replace(model, edges=lengths, blooming=blooming, slack=0.0)) - 2.0 * unusual**2

    start: Floats = np.asarray(np.linalg.solve(towards, [*model.edges, model.blooming]), np.float64)
    optimum, inverse, highest = climb(log_evidence, start, free, step * np.array([0.02, 0.02, 1.0e-3]))
    return towards @ optimum, towards @ inverse @ towards.T, highest


def learn_size(
    planes: Sequence[Plane],
    model: BoardModel,
    edges: tuple[float, float],
    is_blooming_open: bool,
    stated: tuple[float, float] | None = None,
) -> tuple[BoardModel, SizeEstimate]:
    """Return the model with the open edges and the blooming that all boards together show, and their estimate.

    The climb starts at the stated size, and at the table's best sizes that explain the boards better.

    A beam on an edge and on a body behind it returns from between them. As far inside of the edge as the widest beams
    reach, such returns show neither size nor blooming.
    """
    solid = [plane for plane in planes if plane.extent.has_many_rings][:_SOME]
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
    free = [*open_edges, *([2] if is_blooming_open else [])]
    for step, counted in ((1.0, few), (0.4, planes)):
        best, covariance, _ = max(fits, key=lambda fit: fit[2])
        fitted = replace(fitted, edges=(float(best[0]), float(best[1])), blooming=float(best[2]), slack=0.0)
        if step < 1.0 and len(solid) >= ENOUGH:
            fitted = learn_wrong(solid, _learn_softness(solid, fitted)[0])
        fits = [_fit_edges(counted, fitted, free, step)]
    best, covariance, _ = fits[0]
    fixed = covariance - np.outer(covariance[2], covariance[2]) / max(covariance[2, 2], 1e-12)
    # All boards are cut alike, and beams answer at the same place of them.
    spread = covariance + np.diag([EDGE_M**2 + BEAM_M**2, EDGE_M**2 + BEAM_M**2, _LEAST_BLOOMING_RAD**2])
    if is_blooming_open:
        # Hands and bends move each board's edges by `EDGE_M`, so boards show blooming by their range of distances
        # only.
        lever = max(float(np.std([np.median(plane.rays.reach) for plane in planes])) * math.sqrt(len(planes)), 1e-3)
        towards = np.array([-2.0 * _mean_reach(planes) * (axis in free) for axis in (0, 1)] + [1.0])
        spread += (EDGE_M / lever) ** 2 * np.outer(towards, towards)
    size = SizeEstimate(best, spread)
    (first, other, blooming), usual = size.usual()
    model = replace(fitted, inset=model.inset, edges=(float(first), float(other)), blooming=float(blooming))
    slack, sigma = 2.0 * np.sqrt(np.diag(fixed)[:2].clip(0.0).max()), math.sqrt(usual[2, 2]) * is_blooming_open
    return replace(model, slack=float(slack), blooming_sigma=sigma), size


def _learn_blooming(planes: Sequence[Plane], model: BoardModel, step: float, widths: Floats) -> BoardModel:
    """Return the model with the blooming that the near sweeps show of a board of known size."""
    best, covariance, _ = _fit_edges(planes, model, [2], step)
    sigma = math.hypot(math.sqrt(covariance[2, 2]), EDGE_M / (_mean_reach(planes) * math.sqrt(len(planes))))
    blooming, sigma = usual_blooming(float(best[2]), sigma, widths)
    return replace(model, blooming=blooming, blooming_sigma=sigma)


def first_blooming(planes: Sequence[Plane], model: BoardModel, open_size: BoardModel) -> BoardModel:
    """Return the model with the blooming that makes its board look as large as that of ``open_size``."""
    blooming = open_size.blooming + (sum(open_size.edges) - sum(model.edges)) / (4.0 * _mean_reach(planes))
    blooming = min(max(blooming, BLOOMING_RAD[0]), BLOOMING_RAD[1])
    return replace(model, blooming=blooming, inset=max(blooming, BEAM_SIGMA_RAD), softness=open_size.softness)


def _mean_reach(planes: Sequence[Plane]) -> float:
    """Return the mean distance of planes, metres."""
    return float(np.mean([np.median(plane.rays.reach) for plane in planes]))
