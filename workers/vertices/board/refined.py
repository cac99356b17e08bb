"""``refined`` over a range of sweeps: learn, look at each sweep by itself, then let its neighbours help.

Each sweep ends as a vertex or as a rejection with a reason. `_look_in_region` finds the sweep's candidates, and
`_decide` chooses one of them and tests it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from apexcal.documents.detectors import Options, Quality
from workers.readers.recording import Sweep
from workers.vertices.board.board_estimate import BoardEstimate
from workers.vertices.board.candidate import PlaneCandidate
from workers.vertices.board.estimate import estimate_board, find_boards
from workers.vertices.board.learning import learn
from workers.vertices.board.model import BoardModel
from workers.vertices.board.neighbours import (
    TimedEstimate,
    is_confirmed,
    neighbour_count,
    path_deviation,
    roll_prior,
)
from workers.vertices.board.surroundings import (
    apex_time,
    describe_candidate,
    describe_objection,
    flags_of,
    is_overtopped,
)
from workers.vertices.board.upright_rectangle import is_clearly_a_board, is_likelier_than_upright
from workers.vertices.corners import corners_of
from workers.vertices.sweep_source import Area, OnSweep, SweepSource
from workers.vertices.vertex import Answers, Covariance, Rejection, Vertex

# A sweep has some ten planes that could be a board; in 200 sweeps without one, none may pass: log(2000) = 7.6.
# Five points of a shoulder and a leg can lie like a board; six hardly ever do. On the path of the sweeps before and
# after, four are enough: a sensor that turns fast has no more on a far board.
_LEAST_SUPPORT, LEAST_POINTS, _ON_PATH_POINTS = 8.0, 6, 4
_LEAN = 2.5  # standard deviations: a plane through a head or legs and the board leans farther
_OFF_PATH, _FAR_OFF_PATH = 3.5, 5.0
_MISSED = ("no_points", "too_few_rings", "not_a_board")
_TRIED = 64  # sweeps of a recording
_RIVAL = 12.0
_RIVAL_M = 0.4
_FINE_AZIMUTH, _FINE_ELEVATION = math.radians(0.055), math.radians(0.043)


@dataclass(frozen=True, slots=True, eq=False)
class _SweepCandidates:
    """A sweep's candidates by itself, the likeliest first, with their flags; or why there are none."""

    candidates: tuple[TimedEstimate, ...]
    flags: tuple[tuple[str, ...], ...]
    rejection: Rejection


def run(
    source: SweepSource,
    area: Area,
    options: Options,
    indices: range,
    on_sweep: OnSweep,
    model: BoardModel | None = None,
) -> Answers:
    """See :func:`workers.vertices.detectors.detect_range`. ``model``: learned already, or None."""
    model = model or learn(source, area, options, lambda: on_sweep(indices.start))
    if model is None:
        inside = [area.inside(source.sweep(index)).any() for index in indices]
        return Answers([Rejection("size_not_stated" if some else "no_points") for some in inside])
    reach = neighbour_count(source) if options["track"] and not model.is_posed else 0
    wider = range(max(0, indices.start - reach), min(len(source), indices.stop + reach))
    candidates_in: dict[int, _SweepCandidates] = {}
    for index in wider:
        candidates_in[index] = _look_in_region(source.sweep(index), area, model)
        on_sweep(index)
    outcomes = {index: _decide(index, candidates_in, model, options, reach) for index in indices}
    return Answers(list((outcomes | _look_outside_region(source, area, model, outcomes)).values()), model.size)


def _look_outside_region(
    source: SweepSource, area: Area, model: BoardModel, outcomes: Mapping[int, Vertex | Rejection]
) -> dict[int, Rejection]:
    """Return better rejections for some sweeps without a board in the region: a board stands outside it."""
    step = max(1, len(source) // _TRIED)
    better: dict[int, Rejection] = {}
    for index, answer in outcomes.items():
        if index % step or isinstance(answer, Vertex) or answer.reason not in _MISSED:
            continue
        sweep = source.sweep(index)
        outside = area.outside(sweep)
        boards = (board for _, board in find_boards(sweep, outside, model)) if outside.any() else ()
        for board in boards:
            if board.plane.extent.has_many_rings and board.is_trustworthy and is_likelier_than_upright(board, model):
                x, y, _ = board.xyz.tolist()
                better[index] = reject("outside_the_region", board, f"at x {x:.1f}, y {y:.1f} m")
                break
    return better


def _look_in_region(sweep: Sweep, area: Area, model: BoardModel) -> _SweepCandidates:
    inside = area.inside(sweep)
    if not inside.any():
        return _SweepCandidates((), (), Rejection("no_points"))
    every = find_boards(sweep, inside, model)
    boards = [pair for pair in every if not is_overtopped(*pair, model)]
    if not boards:
        return _SweepCandidates((), (), reject("overtopped", every[0][1]) if every else Rejection("too_few_rings"))
    first = boards[0]
    if any(board.is_consistent for _, board in boards):
        if area.fixed_left_out:
            # The likeliest counts. Another one is a board only on the path of the likeliest of other sweeps.
            while boards and boards[0][1].is_consistent and not is_likelier_than_upright(boards[0][1], model):
                boards = boards[1:]
        else:
            # Nothing shows that it is carried, so its shape alone must distinguish it from what stands about. With
            # level edges it has the shape of a sign.
            has_own_shape = not model.upper_corner
            boards = [
                pair
                for pair in boards
                if not pair[1].is_consistent or (has_own_shape and is_clearly_a_board(pair[1], model))
            ]
        if not any(board.is_consistent for _, board in boards):
            return _SweepCandidates((), (), reject("upright_object", first[1]))
    candidates = [
        TimedEstimate(sweep.stamp_ns + apex_time(sweep, candidate, board), board) for candidate, board in boards
    ]
    flags = [_flags(candidate, board, boards) for candidate, board in boards]
    return _SweepCandidates(tuple(candidates), tuple(flags), Rejection(""))


def reject(reason: str, board: BoardEstimate, why: str = "") -> Rejection:
    """Return a rejection with a description of the likeliest candidate."""
    return Rejection(reason, describe_candidate(board) + (f", {why}" if why else ""), board.plane.extent.points)


def _flags(
    candidate: PlaneCandidate, board: BoardEstimate, boards: Sequence[tuple[PlaneCandidate, BoardEstimate]]
) -> tuple[str, ...]:
    rivals = [
        other
        for _, other in boards
        if other is not board
        and float(np.linalg.norm(other.xyz - board.xyz)) > _RIVAL_M
        and other.joint_evidence > board.joint_evidence - _RIVAL
        and other.is_consistent
    ]
    return (*flags_of(candidate, board), *(["second_board"] if rivals else []))


def _decide(
    index: int, candidates_in: dict[int, _SweepCandidates], model: BoardModel, options: Options, reach: int
) -> Vertex | Rejection:
    own = candidates_in[index]
    if not own.candidates:
        return own.rejection
    around = [i for i in range(index - reach, index + reach + 1) if i != index and i in candidates_in]
    others = [
        candidates_in[i].candidates[0]
        for i in around
        if candidates_in[i].candidates and candidates_in[i].candidates[0].board.is_trustworthy
    ]
    chosen, path, least = _choose(own.candidates, others, model)
    deviation = path or 0.0
    candidate = own.candidates[chosen]
    flags = own.flags[chosen]
    board = candidate.board
    if others:
        board = estimate_board(board.plane, replace(model, roll=roll_prior(candidate, others, model))) or board
    if not is_board(board, model, least):
        return reject("not_a_board", board, describe_objection(board, model, least))
    if model.upper_corner and not board.plane.extent.has_many_rings:  # a trunk is a level rectangle too
        return reject("too_few_rings", board, "a board with level edges needs four")
    if model.upper_corner and model.size is not None and model.size.contradicts:
        return reject("never_shown", board, "and the near sweeps show a thing of another size")
    if model.upper_corner and reach and not is_confirmed(candidate, others):
        return reject("upright_object", board, "which the sweeps before and after do not show there")
    if board.plane.extent.is_like_a_person and path is None and not is_confirmed(candidate, others):
        return reject("like_a_person", board)
    if not model.is_shown and not (board.plane.extent.has_many_rings and _size_known(options, model)):
        return reject("never_shown", board)
    sigma_deg = math.degrees(board.sigma)
    if sigma_deg > options["max_sigma_deg"]:
        return reject("too_uncertain", board, f"its corner is known to {sigma_deg:.2f} degrees")
    if deviation >= _FAR_OFF_PATH:
        return reject("off_the_track", board, f"{deviation:.0f} deviations off the path")
    if deviation >= _OFF_PATH:
        flags = (*flags, "track_jump")
    return vertex_of(index, candidate.time_ns, board, flags, options, model)


def _choose(
    candidates: Sequence[TimedEstimate], others: Sequence[TimedEstimate], model: BoardModel
) -> tuple[int, float | None, int]:
    """Return the first candidate that is a board on the path of the others; if none is, the first.

    Returns:
        Its index; standard deviations by which it lies off the path, None if there is no path; points that it needs.
    """
    judged: list[tuple[int, float | None, int]] = []
    for number, candidate in enumerate(candidates):
        if judged and not is_board(candidate.board, model, _ON_PATH_POINTS):
            continue
        path = path_deviation(candidate, others)
        judged.append((number, path, LEAST_POINTS if path is None or path >= _OFF_PATH else _ON_PATH_POINTS))
        if (path or 0.0) < _OFF_PATH and is_board(candidate.board, model, judged[-1][2]):
            return judged[-1]
    return judged[0]


def is_board(board: BoardEstimate, model: BoardModel, least_points: int) -> bool:
    """Return whether the rays agree with a board, and it rests on enough returns."""
    w, (mean, spread) = board.plane.w, model.tilt
    upright = board.plane.extent.has_many_rings or abs(-w[2] / w[0] - mean) < _LEAN * spread
    enough = board.joint_evidence >= _LEAST_SUPPORT and board.plane.extent.points >= least_points
    return upright and enough and board.is_consistent


def vertex_of(
    index: int, time_ns: int, board: BoardEstimate, flags: tuple[str, ...], options: Options, model: BoardModel
) -> Vertex:
    """Return the vertex of sweep ``index``, with the board's other corners if its size is stated."""
    x, y, z = board.xyz.tolist()
    (aa, ae, ar), (ea, ee, er), (ra, re, rr) = board.covariance.tolist()
    covariance: Covariance = ((aa, ae, ar), (ea, ee, er), (ra, re, rr))
    fine = board.sigma_azimuth <= _FINE_AZIMUTH and board.sigma_elevation <= _FINE_ELEVATION
    quality: Quality = "fine" if fine else "usable"
    return Vertex(
        xyz=(x, y, z),
        time_ns=time_ns,
        ring=board.plane.extent.top_ring,
        sweep_index=index,
        points_used=board.plane.extent.points,
        detector="refined",
        covariance=covariance,
        quality=quality,
        flags=flags,
        roll=(board.hold.fall - math.radians(45.0), board.hold.roll_sigma),
        corners=corners_of(board, math.radians(options["max_sigma_deg"])) if _size_known(options, model) else None,
    )


def _size_known(options: Options, model: BoardModel) -> bool:
    is_stated = options["board_width_m"] > 0.0 and options["board_height_m"] > 0.0
    return is_stated and not (model.size is not None and model.size.replaces)
