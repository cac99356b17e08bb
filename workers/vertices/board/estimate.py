"""The board in one sweep: the posterior of apex and roll in each candidate's plane, and which candidate is likeliest.

Either edge of the board may be the one to the lower left, so the posterior has two modes (`PosteriorMode`). Each is
integrated by itself (`posterior.find_corner`), and both are averaged by their evidence. The covariance then gains
what
one sweep cannot show: how straight the edges are, where in a beam they answer, and errors that all rings share.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workers.readers.recording import Sweep
from workers.vertices.board.board_estimate import (
    BoardAgreement,
    BoardEstimate,
    Contradictions,
    HoldEstimate,
    PosteriorMode,
)
from workers.vertices.board.candidate import Mask, Plane, PlaneCandidate
from workers.vertices.board.candidate_search import CONFIDENT, find_planes, open_windows
from workers.vertices.board.model import BEAM_M, EDGE_M, ROLLS, BoardModel, Floats
from workers.vertices.board.outline import on_board_probability
from workers.vertices.board.posterior import find_corner
from workers.vertices.board.surroundings import angles_of_point

_UNLIKELY = 0.05
_HOPELESS = 12.0  # log odds from which the other mode is not followed further


class _ModeMoments(NamedTuple):
    """A mode's edges (m), the log of its share of the evidence, and its moments as of `find_corner`."""

    edges: tuple[float, float]
    evidence: float
    moments: Floats


class BoardPosterior(NamedTuple):
    """The posterior in a plane.

    Attributes:
        modes: one or two.
        evidence: see `BoardAgreement`.
        roll_log_likelihood: see `HoldEstimate`.
    """

    modes: tuple[_ModeMoments, ...]
    evidence: float
    roll_log_likelihood: Floats


def estimate_board(plane: Plane, model: BoardModel, *, coarse: bool = False) -> BoardEstimate | None:
    """Return the board in a plane, averaged over both modes; None if no board explains the rays.

    Args:
        coarse: see :func:`board_posterior`.
    """
    posterior = board_posterior(plane, model, coarse=coarse)
    if posterior is None:
        return None
    moments = [mode.moments for mode in posterior.modes]
    weight = np.exp(np.array([mode.evidence for mode in posterior.modes]) - posterior.evidence)
    means = np.array(
        [[*mode.moments[1:3], mode.moments[3] - model.rest_angle(mode.edges)] for mode in posterior.modes]
    )
    mean: Floats = weight @ means
    apart = means - mean
    covariance = np.einsum("w,wij->ij", weight, [_covariance(each) for each in moments]) + (apart.T * weight) @ apart
    xyz, own, errors = _apex(plane, model, mean[:2], covariance[:2, :2])
    fall = float(weight @ np.array([each[3] for each in moments]))
    modes = tuple(
        PosteriorMode(share, mode.edges, mode.moments[1:4], _covariance(mode.moments))
        for share, mode in zip(weight.tolist(), posterior.modes, strict=True)
    )
    hold = HoldEstimate(
        float(mean[2]), math.sqrt(max(float(covariance[2, 2]), 1e-12)), fall, modes, posterior.roll_log_likelihood
    )
    agreement = _agreement(plane, model, posterior, posterior.modes[int(np.argmax(weight))])
    sigma = math.sqrt(own[0, 0] + own[1, 1])
    return BoardEstimate(plane, xyz, errors, sigma, hold, agreement, model.upper_corner)


def _apex(plane: Plane, model: BoardModel, at: Floats, covariance: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the apex (3,), and two covariances (3, 3) over its angles and range: from the rays alone, and in all.

    Args:
        at: (2,) metres to the left and up in the plane; covariance: (2, 2) of it.
    """
    xyz, J, along, rises = angles_of_point(
        plane.R_window_lidar, plane.w, plane.covariance + plane.ring_covariance, at
    )
    own = J @ covariance @ J.T
    errors = own + (EDGE_M**2 + BEAM_M**2) * (J @ J.T)
    # One sweep cannot show a range error that all rings share. It is assumed as large as the rings' differences.
    errors[2, 2] += along + model.bias**2
    errors[2, 2] = max(errors[2, 2], EDGE_M**2)  # boards bend by as much as their edges are off
    # Both edges move out, so the tip rises by the square root of two, and an upper corner goes up and aside as far.
    if model.upper_corner:
        out: Floats = float(np.linalg.norm(xyz)) * J @ np.array([model.upper_corner, 1.0])
        errors += model.blooming_sigma**2 * np.outer(out, out)
    else:
        errors += 2.0 * model.blooming_sigma**2 * np.outer(rises, rises)
    return xyz, own, errors


def board_posterior(plane: Plane, model: BoardModel, *, coarse: bool = False) -> BoardPosterior | None:
    """Return both modes of the posterior in a plane; None if no board explains the rays.

    Args:
        coarse: for comparing models: quicker, and good enough for the evidence.
    """
    modes: list[_ModeMoments] = []
    grid = np.full((2, ROLLS.size), -math.inf)
    for share, swapped in sorted([(1.0 - model.swapped, False), (model.swapped, True)], reverse=True):
        floor = modes[0].evidence - math.log(share) - _HOPELESS if modes else -math.inf
        edges = _edges(model, swapped)
        best = _corner(plane, model, edges, coarse, floor)
        if best is not None:
            moments, log_likelihood, rolls = best
            modes.append(_ModeMoments(edges, math.log(share) + float(moments[0]), moments))
            grid[int(swapped)] = np.interp(
                ROLLS, rolls - model.rest_angle(edges), log_likelihood, left=-math.inf, right=-math.inf
            )
    if not modes:
        return None
    return BoardPosterior(tuple(modes), float(np.logaddexp.reduce([mode.evidence for mode in modes])), grid)


def _edges(model: BoardModel, swapped: bool) -> tuple[float, float]:
    """Return the lengths of the edges to the lower left and to the lower right."""
    first, other = model.edges
    return (other, first) if swapped else (first, other)


def _agreement(plane: Plane, model: BoardModel, posterior: BoardPosterior, likeliest: _ModeMoments) -> BoardAgreement:
    """Return how well the rays agree with the board in the middle of its likeliest mode."""
    edges, moments, rays = likeliest.edges, likeliest.moments, plane.rays
    outline = (model.softness, model.slack, *edges, moments)
    down = edges[0] * math.sin(moments[3]), edges[1] * math.cos(moments[3])
    side = moments[2] - (sum(down) if model.upper_corner else min(down))
    on_board = on_board_probability(rays.left, rays.up, _blooming_m(plane, model), rays.reach, *outline)
    hit, missed = rays.ratio > CONFIDENT, rays.has_return & (rays.ratio < 1.0 / CONFIDENT)
    # Near a soft edge either answer is as expected.
    contrary = (missed & (on_board > 1.0 - _UNLIKELY)) | (hit & (on_board < _UNLIKELY))
    at_edges = _above_and_below(rays.up[contrary] - side, rays.up[rays.has_return] - side)
    # A wall is met far beside the board too, not only at the ends of its segments.
    left, up = plane.returns.hits[0], plane.returns.hits[1]
    middle = float(np.median(rays.reach))
    reach = np.full_like(left, middle)
    beside = on_board_probability(left, up, reach * model.blooming, reach, *outline) < _UNLIKELY
    within = on_board_probability(left, up, np.zeros_like(left), reach, *outline)
    # Behind a board nothing is seen, also where no ray was chosen.
    left, low, mixed = plane.returns.misses
    reach = np.full_like(left, middle)
    inset_m = _blooming_rad(mixed > 0.0, plane, model) * middle
    through = on_board_probability(left, low, inset_m, reach, *outline) > 1.0 - _UNLIKELY
    wrong = np.where(rays.is_below, model.wrong_below, model.wrong)
    dropouts = rays.ratio.size * model.dropout_rate * math.log(model.dropout_rate)
    return BoardAgreement(
        returns=_above_and_below(np.concatenate([up[beside], low[through]]) - side, up - side),
        at_edges=at_edges,
        on_board_share=float(within.mean()) if within.size else 0.0,
        moving_share=_moving_share(plane, model, edges, moments) if model.upper_corner else 1.0,
        wrong=(model.wrong, model.wrong_below),
        best=max(float(mode.moments[10]) for mode in posterior.modes),
        expected=float(np.sum(wrong * np.log(wrong))) + dropouts,
        evidence=posterior.evidence,
    )


def _above_and_below(contrary_m: Floats, returns_m: Floats) -> tuple[Contradictions, Contradictions]:
    """Return the counts above and below the side corners, from heights (m) relative to these."""
    above, all_above = int(np.count_nonzero(contrary_m > 0.0)), int(np.count_nonzero(returns_m > 0.0))
    return Contradictions(above, all_above), Contradictions(contrary_m.size - above, returns_m.size - all_above)


def _moving_share(plane: Plane, model: BoardModel, edges: tuple[float, float], moments: Floats) -> float:
    """Return `BoardAgreement.moving_share` of the board in the middle of its posterior."""
    left, up, moves = plane.returns.near
    reach = np.full_like(left, float(np.median(plane.rays.reach)))
    on_board = on_board_probability(
        left, up, np.zeros_like(left), reach, model.softness, model.slack, *edges, moments
    )
    return float(on_board @ moves) / max(float(on_board.sum()), 1.0)


def depths_inside_edges(board: BoardEstimate) -> tuple[Floats, Floats]:
    """Return, for the K returns on the estimated board, radians to the nearest edge (K,), and 1 if mixed, else 0."""
    mode, rays, hits = board.hold.likeliest, board.plane.rays, board.plane.returns.hits
    mixed = rays.is_mixed & rays.has_return & (rays.ratio < 1.0 / CONFIDENT)
    reach = np.concatenate([rays.reach[mixed], np.full(hits.shape[1], float(np.median(rays.reach)))])
    x = np.concatenate([rays.left[mixed], hits[0]]) - mode.mean[0]
    y = np.concatenate([rays.up[mixed], hits[1]]) - mode.mean[1]
    cosine, sine = math.cos(mode.mean[2]), math.sin(mode.mean[2])
    p, q = cosine * x - sine * y, -sine * x - cosine * y
    depth = np.minimum(np.minimum(p, mode.edges[0] - p), np.minimum(q, mode.edges[1] - q)) / reach
    on_board = depth > 0.0
    return depth[on_board], np.repeat([1.0, 0.0], [np.count_nonzero(mixed), hits.shape[1]])[on_board]


def _blooming_m(plane: Plane, model: BoardModel) -> Floats:
    """Return (N,) metres by which the edges appear shifted outward at each ray."""
    return plane.rays.reach * _blooming_rad(plane.rays.is_mixed, plane, model)


def _blooming_rad(is_mixed: Mask, plane: Plane, model: BoardModel) -> Floats:
    """Return (N,) radians by which edges appear shifted at each ray: outward, or inward (negative) for mixed returns.

    A beam that meets the edge and something close behind it gives one return between the two, off the plane. Such
    returns begin inside the edge by `BoardModel.inset`, and at least by the blooming. If the inset was not learned,
    they begin inside by the blooming, and on few rings they count as misses.
    """
    if model.inset is not None:
        return np.where(is_mixed, -max(model.inset, model.blooming), model.blooming)
    return np.where(is_mixed & plane.extent.has_many_rings, -model.blooming, model.blooming)


def _covariance(moments: Floats) -> Floats:
    """Return the covariance (3, 3) of left, up and roll among the moments of `find_corner`."""
    ll, uu, rr, lu, lr, ur = moments[4:10]
    return np.array([[ll, lu, lr], [lu, uu, ur], [lr, ur, rr]])


def _corner(
    plane: Plane, model: BoardModel, edges: tuple[float, float], coarse: bool, floor: float
) -> tuple[Floats, Floats, Floats] | None:
    """Return `find_corner`; None if no board explains the rays, or the first pass ends below ``floor``."""
    rays = plane.rays
    hits = rays.ratio > CONFIDENT
    if not hits.any():
        return None
    best = find_corner(
        rays.left, rays.up, _blooming_m(plane, model), rays.reach * model.softness,
        rays.contaminated_ratio(model), hits, edges[0], edges[1], model.slack,
        model.rest_angle(edges) + model.roll[0], model.roll[1], coarse, floor,
    )  # fmt: skip
    return best if best[0][0] > -1e299 else None


def find_boards(
    sweep: Sweep, inside: Mask, model: BoardModel, most: int = 5
) -> list[tuple[PlaneCandidate, BoardEstimate]]:
    """Return the boards in the likeliest planes of a sweep: those that are consistent first, then the likeliest.

    Args:
        inside: (N,) which points of the sweep may be the board's.
        most: how many planes are looked at.
    """
    boards = [
        (candidate, board)
        for candidate in find_planes(open_windows(sweep, inside, model.grid), model, most)
        if (board := estimate_board(candidate.plane, model)) is not None
    ]
    return sorted(boards, key=lambda pair: (not pair[1].is_consistent, -pair[1].joint_evidence))
