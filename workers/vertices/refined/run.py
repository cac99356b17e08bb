"""``refined`` over a range of sweeps: learn, look at each sweep by itself, then let the track help."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from apexcal.documents.detectors import Options, Quality
from workers.readers.recording import Sweep
from workers.vertices.refined.board import find_boards, locate
from workers.vertices.refined.board_model import BoardModel, Fix, Sighting
from workers.vertices.refined.corners import corners_of
from workers.vertices.refined.learning import learn
from workers.vertices.refined.surroundings import apex_time, flags_of, overtopped
from workers.vertices.refined.track import TimedFix, confirmed, off_path, reach_of, roll_prior, trustworthy
from workers.vertices.refined.upright import clearly_a_board, likelier_than_upright
from workers.vertices.sweep_source import Area, OnSweep, SweepSource
from workers.vertices.vertex import Answers, Covariance, Rejection, Vertex

# A sweep has some ten planes that could be a board; in 200 sweeps without one, none may pass: log(2000) = 7.6.
# Five points of a shoulder and a leg can lie like a board; six hardly ever do. On the path of the sweeps before and
# after, four are enough: a sensor that turns fast has no more on a far board.
_LEAST_SUPPORT, _LEAST_POINTS, _ON_PATH_POINTS = 8.0, 6, 4
_LEAN = 2.5  # standard deviations: a plane through a head or legs and the board leans farther
_OFF_PATH, _FAR_OFF_PATH = 3.5, 5.0
_RIVAL = 12.0
_RIVAL_M = 0.4
_FINE_AZIMUTH, _FINE_ELEVATION = math.radians(0.055), math.radians(0.043)


@dataclass(frozen=True, slots=True, eq=False)
class _Findings:
    """What a sweep tells by itself: candidates, the likeliest first, or the reason why there are none."""

    candidates: tuple[TimedFix, ...]
    flags: tuple[tuple[str, ...], ...]
    reason: str


def run(source: SweepSource, area: Area, options: Options, indices: range, on_sweep: OnSweep) -> Answers:
    """See :func:`workers.vertices.detectors.detect_range`."""
    model = learn(source, area, options, lambda: on_sweep(indices.start))
    reach = reach_of(source) if options["track"] and not model.poses else 0
    wider = range(max(0, indices.start - reach), min(len(source), indices.stop + reach))
    found_in: dict[int, _Findings] = {}
    for index in wider:
        found_in[index] = _find(source.sweep(index), area, model)
        on_sweep(index)
    return Answers([_settle(index, found_in, model, options, reach) for index in indices], model.size)


def _find(sweep: Sweep, area: Area, model: BoardModel) -> _Findings:
    inside = area.inside(sweep)
    if not inside.any():
        return _Findings((), (), "no_points")
    every = find_boards(sweep, inside, model)
    boards = [pair for pair in every if not overtopped(*pair, model)]
    if not boards:
        return _Findings((), (), "overtopped" if every else "too_few_rings")
    if any(fix.explained for _, fix in boards):
        if area.fixed_left_out:
            # The first one counts. What comes after it is a board only on the path of others that came first.
            while boards and boards[0][1].explained and not likelier_than_upright(boards[0][1], model):
                boards = boards[1:]
        else:
            # Nothing shows that it is carried: its shape alone must tell it from what stands about.
            boards = [pair for pair in boards if not pair[1].explained or clearly_a_board(pair[1], model)]
        if not any(fix.explained for _, fix in boards):
            return _Findings((), (), "upright_object")
    candidates = [TimedFix(sweep.stamp_ns + apex_time(sweep, sighting, fix), fix) for sighting, fix in boards]
    flags = [_flags(sighting, fix, boards) for sighting, fix in boards]
    return _Findings(tuple(candidates), tuple(flags), "")


def _flags(sighting: Sighting, fix: Fix, boards: Sequence[tuple[Sighting, Fix]]) -> tuple[str, ...]:
    rivals = [
        other
        for _, other in boards
        if other is not fix
        and float(np.linalg.norm(other.xyz - fix.xyz)) > _RIVAL_M
        and other.support > fix.support - _RIVAL
        and other.explained
    ]
    return (*flags_of(sighting, fix), *(["second_board"] if rivals else []))


def _settle(
    index: int, found_in: dict[int, _Findings], model: BoardModel, options: Options, reach: int
) -> Vertex | Rejection:
    own = found_in[index]
    if not own.candidates:
        return Rejection(own.reason)
    around = [i for i in range(index - reach, index + reach + 1) if i != index and i in found_in]
    others = [
        found_in[i].candidates[0]
        for i in around
        if found_in[i].candidates and trustworthy(found_in[i].candidates[0].fix)
    ]
    chosen, path, least = _choose(own.candidates, others, model)
    beside = path or 0.0
    candidate = own.candidates[chosen]
    flags = own.flags[chosen]
    fix = candidate.fix
    if others:
        fix = locate(fix.plane, replace(model, roll=roll_prior(candidate, others, model))) or fix
    if not _is_board(fix, model, least):
        return Rejection("not_a_board")
    if fix.plane.like_a_person and path is None and not confirmed(candidate, others):
        return Rejection("like_a_person")
    if not model.shown and not (fix.plane.telling and _size_known(options, model)):
        return Rejection("never_shown")
    if fix.sigma > math.radians(options["max_sigma_deg"]):
        return Rejection("too_uncertain")
    if beside >= _FAR_OFF_PATH:
        return Rejection("off_the_track")
    if beside >= _OFF_PATH:
        flags = (*flags, "track_jump")
    return _vertex(index, candidate.time_ns, fix, flags, options, model)


def _choose(
    candidates: Sequence[TimedFix], others: Sequence[TimedFix], model: BoardModel
) -> tuple[int, float | None, int]:
    """The first candidate that is a board on the path of the others; if none is, the first.

    Returns:
        Its number; standard deviations by which it lies beside the path, None if there is none; points that it needs.
    """
    judged: list[tuple[int, float | None, int]] = []
    for number, candidate in enumerate(candidates):
        if judged and not _is_board(candidate.fix, model, _ON_PATH_POINTS):
            continue
        path = off_path(candidate, others)
        judged.append((number, path, _LEAST_POINTS if path is None or path >= _OFF_PATH else _ON_PATH_POINTS))
        if (path or 0.0) < _OFF_PATH and _is_board(candidate.fix, model, judged[-1][2]):
            return judged[-1]
    return judged[0]


def _is_board(fix: Fix, model: BoardModel, least_points: int) -> bool:
    w, (mean, spread) = fix.plane.w, model.tilt
    upright = fix.plane.telling or abs(-w[2] / w[0] - mean) < _LEAN * spread
    enough = fix.support >= _LEAST_SUPPORT and fix.plane.points >= least_points
    return upright and enough and fix.explained


def _vertex(
    index: int, time_ns: int, fix: Fix, flags: tuple[str, ...], options: Options, model: BoardModel
) -> Vertex:
    x, y, z = fix.xyz.tolist()
    (aa, ae, ar), (ea, ee, er), (ra, re, rr) = fix.covariance.tolist()
    covariance: Covariance = ((aa, ae, ar), (ea, ee, er), (ra, re, rr))
    fine = fix.sigma_azimuth <= _FINE_AZIMUTH and fix.sigma_elevation <= _FINE_ELEVATION
    quality: Quality = "fine" if fine else "usable"
    return Vertex(
        xyz=(x, y, z),
        time_ns=time_ns,
        ring=fix.plane.top_ring,
        sweep_index=index,
        points_used=fix.plane.points,
        detector="refined",
        covariance=covariance,
        quality=quality,
        flags=flags,
        roll=(fix.fall - math.radians(45.0), fix.roll_sigma),
        corners=corners_of(fix, math.radians(options["max_sigma_deg"])) if _size_known(options, model) else None,
    )


def _size_known(options: Options, model: BoardModel) -> bool:
    is_stated = options["board_width_m"] > 0.0 and options["board_height_m"] > 0.0
    return is_stated and not (model.size is not None and model.size.replaces)
