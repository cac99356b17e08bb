"""``refined`` over a range of sweeps: learn, look at each sweep by itself, then let its neighbours help."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from apexcal.documents.detectors import Options, Quality
from workers.readers.recording import Sweep
from workers.vertices.board.estimate import find_boards, locate
from workers.vertices.board.learning import learn
from workers.vertices.board.model import BoardModel, Fix, Floats, Sighting
from workers.vertices.board.surroundings import (
    apex_time,
    clearly_a_board,
    flags_of,
    likelier_than_upright,
    no_board,
    overtopped,
    thing,
)
from workers.vertices.corners import corners_of
from workers.vertices.sweep_source import Area, OnSweep, SweepSource, stamp_of
from workers.vertices.vertex import Answers, Covariance, Rejection, Vertex

_REACH, _MOST_REACH, _REACH_S = 10, 30, 1.0  # sweeps to either side; more if the sensor turns faster
LONGEST_S = 1.5
FASTEST_M_S = 3.0
TREMBLE_M = 0.2
_ROLL_LENGTH_S = 0.45  # how long a held board keeps its roll
_ROLL_FLOOR = math.radians(0.6)
_ROLL_INFLATION = 1.5  # posteriors of single sweeps are no Gaussians, and their errors correlate a little
_FEWEST = 4
_SWAY_M = 0.03
_SHOULDERS_M = 0.5  # breadth of a standing person (DIN 33402-2): two people stand farther apart


@dataclass(frozen=True, slots=True, eq=False)
class TimedFix:
    """A sweep's apex by itself."""

    time_ns: int
    fix: Fix


def reach_of(source: SweepSource) -> int:
    """How many sweeps to either side help."""
    count = len(source)
    if count < 2:
        return _REACH
    period_s = (stamp_of(source, count - 1) - stamp_of(source, 0)) * 1e-9 / (count - 1)
    return max(_REACH, min(round(_REACH_S / period_s), _MOST_REACH)) if period_s > 0.0 else _REACH


def roll_prior(own: TimedFix, others: Sequence[TimedFix], model: BoardModel) -> tuple[float, float]:
    """Mean and standard deviation of the roll, from the neighbours that the walker can have come from or gone to.

    Gaussian-process regression; each neighbour's roll counts as its posterior without the prior.
    """
    mean, spread = model.roll
    after = np.array([other.time_ns - own.time_ns for other in others], np.float64) * 1e-9
    apart = np.array([np.linalg.norm(other.fix.xyz - own.fix.xyz) for other in others])
    roll = np.array([other.fix.roll for other in others])
    precision = np.array([other.fix.roll_sigma for other in others]) ** -2.0 - spread**-2.0
    counted = (apart < TREMBLE_M + FASTEST_M_S * np.abs(after)) & (precision > 0.1 * spread**-2.0)
    # A sweep that was recorded twice tells nothing new.
    counted &= (np.abs(after) < LONGEST_S) & (after != 0.0)
    if not counted.any():
        return mean, spread
    after, once = np.unique(after[counted], return_index=True)
    roll, precision = roll[counted][once], precision[counted][once]
    alone = (roll - mean) * (precision + spread**-2.0) / precision
    between = spread**2 * np.exp(-0.5 * ((after[:, None] - after[None, :]) / _ROLL_LENGTH_S) ** 2)
    towards = spread**2 * np.exp(-0.5 * (after / _ROLL_LENGTH_S) ** 2)
    gain = np.linalg.solve(between + np.diag(_ROLL_INFLATION / precision), towards)
    variance = spread**2 - float(gain @ towards)
    return mean + float(gain @ alone), min(math.sqrt(max(variance, 0.0) + _ROLL_FLOOR**2), spread)


def off_path(own: TimedFix, others: Sequence[TimedFix]) -> float | None:
    """Standard deviations by which the apex lies beside the smooth path of its neighbours; None if there is none."""
    near = [other for other in others if abs(other.time_ns - own.time_ns) < LONGEST_S * 1e9]
    if len(near) < _FEWEST:
        return None
    x, y, z = own.fix.xyz.tolist()
    flat, reach = math.hypot(x, y), math.sqrt(x * x + y * y + z * z)
    axes = np.array([[-y / flat, x / flat, 0.0], [-x * z / flat / reach, -y * z / flat / reach, flat / reach]])
    after = np.array([other.time_ns - own.time_ns for other in near], np.float64) * 1e-9
    offset = np.array([axes @ (other.fix.xyz - own.fix.xyz) for other in near])
    sigma = reach * np.array([[other.fix.sigma_azimuth, other.fix.sigma_elevation] for other in near])
    own_sigma = reach * np.array([own.fix.sigma_azimuth, own.fix.sigma_elevation])
    powers = np.vander(after, 3 if len(near) >= 2 * _FEWEST else 2, increasing=True)
    return max(_beside(powers, offset[:, k], np.hypot(sigma[:, k], _SWAY_M), float(own_sigma[k])) for k in (0, 1))


def confirmed(own: TimedFix, others: Sequence[TimedFix]) -> bool:
    """Whether a neighbour shows a board so near that nobody else can stand there."""
    return any(
        abs(other.time_ns - own.time_ns) < LONGEST_S * 1e9
        and float(np.linalg.norm(other.fix.xyz - own.fix.xyz)) < _SHOULDERS_M
        for other in others
    )


def _beside(powers: Floats, value: Floats, sigma: Floats, own_sigma: float) -> float:
    """Robust polynomial (Cauchy weights) at time 0, where the apex itself is the origin."""
    middle = float(np.median(value))
    doubt = (1.0 + ((value - middle) / (5.0 * sigma)) ** 2) ** -1.0
    inverse = np.eye(powers.shape[1])
    at_zero = middle
    scale = 1.0
    for _ in range(6):
        weight = doubt / sigma**2
        inverse = np.linalg.inv((powers.T * weight) @ powers + 1e-6 * np.eye(powers.shape[1]))
        solution = inverse @ (powers.T @ (weight * value))
        at_zero = float(solution[0])
        scaled = (value - powers @ solution) / sigma
        scale = max(1.4826 * float(np.median(np.abs(scaled))), 1.0)
        doubt = (1.0 + (scaled / (2.5 * scale)) ** 2) ** -1.0
    error = math.sqrt(own_sigma**2 + _SWAY_M**2 + scale**2 * float(inverse[0, 0]) + (scale - 1.0) ** 2 * 0.01)
    return abs(at_zero) / error


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
class _Findings:
    """What a sweep tells by itself: candidates, the likeliest first, or why there are none."""

    candidates: tuple[TimedFix, ...]
    flags: tuple[tuple[str, ...], ...]
    refusal: Rejection


def run(
    source: SweepSource,
    area: Area,
    options: Options,
    indices: range,
    on_sweep: OnSweep,
    model: BoardModel | None = None,
) -> Answers:
    """See :func:`workers.vertices.detectors.detect_range`. ``model``: learned already."""
    model = model or learn(source, area, options, lambda: on_sweep(indices.start))
    if model is None:
        inside = [area.inside(source.sweep(index)).any() for index in indices]
        return Answers([Rejection("size_not_stated" if some else "no_points") for some in inside])
    reach = reach_of(source) if options["track"] and not model.poses else 0
    wider = range(max(0, indices.start - reach), min(len(source), indices.stop + reach))
    found_in: dict[int, _Findings] = {}
    for index in wider:
        found_in[index] = _find(source.sweep(index), area, model)
        on_sweep(index)
    outcomes = {index: _settle(index, found_in, model, options, reach) for index in indices}
    return Answers(list((outcomes | _outside(source, area, model, outcomes)).values()), model.size)


def _outside(
    source: SweepSource, area: Area, model: BoardModel, outcomes: Mapping[int, Vertex | Rejection]
) -> dict[int, Rejection]:
    """What some sweeps say instead that give nothing in the region: whether a wider one would give a board."""
    step = max(1, len(source) // _TRIED)
    better: dict[int, Rejection] = {}
    for index, answer in outcomes.items():
        if index % step or isinstance(answer, Vertex) or answer.reason not in _MISSED:
            continue
        sweep = source.sweep(index)
        outside = area.outside(sweep)
        boards = (fix for _, fix in find_boards(sweep, outside, model)) if outside.any() else ()
        for fix in boards:
            if fix.plane.telling and fix.trustworthy and likelier_than_upright(fix, model):
                x, y, _ = fix.xyz.tolist()
                better[index] = refused("outside_the_region", fix, f"at x {x:.1f}, y {y:.1f} m")
                break
    return better


def _find(sweep: Sweep, area: Area, model: BoardModel) -> _Findings:
    inside = area.inside(sweep)
    if not inside.any():
        return _Findings((), (), Rejection("no_points"))
    every = find_boards(sweep, inside, model)
    boards = [pair for pair in every if not overtopped(*pair, model)]
    if not boards:
        return _Findings((), (), refused("overtopped", every[0][1]) if every else Rejection("too_few_rings"))
    first = boards[0]
    if any(fix.explained for _, fix in boards):
        if area.fixed_left_out:
            # The first one counts. What comes after it is a board only on the path of others that came first.
            while boards and boards[0][1].explained and not likelier_than_upright(boards[0][1], model):
                boards = boards[1:]
        else:
            # Nothing shows that it is carried: its shape alone must tell it from what stands about. With level edges
            # it has the shape of a sign.
            clear = not model.upper_corner
            boards = [pair for pair in boards if not pair[1].explained or (clear and clearly_a_board(pair[1], model))]
        if not any(fix.explained for _, fix in boards):
            return _Findings((), (), refused("upright_object", first[1]))
    candidates = [TimedFix(sweep.stamp_ns + apex_time(sweep, sighting, fix), fix) for sighting, fix in boards]
    flags = [_flags(sighting, fix, boards) for sighting, fix in boards]
    return _Findings(tuple(candidates), tuple(flags), Rejection(""))


def refused(reason: str, fix: Fix, why: str = "") -> Rejection:
    """Return a reason with what the likeliest candidate looks like."""
    return Rejection(reason, thing(fix) + (f", {why}" if why else ""), fix.plane.points)


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
        return own.refusal
    around = [i for i in range(index - reach, index + reach + 1) if i != index and i in found_in]
    others = [
        found_in[i].candidates[0]
        for i in around
        if found_in[i].candidates and found_in[i].candidates[0].fix.trustworthy
    ]
    chosen, path, least = _choose(own.candidates, others, model)
    beside = path or 0.0
    candidate = own.candidates[chosen]
    flags = own.flags[chosen]
    fix = candidate.fix
    if others:
        fix = locate(fix.plane, replace(model, roll=roll_prior(candidate, others, model))) or fix
    if not is_board(fix, model, least):
        return refused("not_a_board", fix, no_board(fix, model, least))
    if model.upper_corner and not fix.plane.telling:  # a trunk is a level rectangle too
        return refused("too_few_rings", fix, "a board with level edges needs four")
    if model.upper_corner and model.size is not None and model.size.contradicts:
        return refused("never_shown", fix, "and the near sweeps show a thing of another size")
    if model.upper_corner and reach and not confirmed(candidate, others):
        return refused("upright_object", fix, "which the sweeps before and after do not show there")
    if fix.plane.like_a_person and path is None and not confirmed(candidate, others):
        return refused("like_a_person", fix)
    if not model.shown and not (fix.plane.telling and _size_known(options, model)):
        return refused("never_shown", fix)
    sigma_deg = math.degrees(fix.sigma)
    if sigma_deg > options["max_sigma_deg"]:
        return refused("too_uncertain", fix, f"its corner is known to {sigma_deg:.2f} degrees")
    if beside >= _FAR_OFF_PATH:
        return refused("off_the_track", fix, f"{beside:.0f} deviations off the path")
    if beside >= _OFF_PATH:
        flags = (*flags, "track_jump")
    return vertex_of(index, candidate.time_ns, fix, flags, options, model)


def _choose(
    candidates: Sequence[TimedFix], others: Sequence[TimedFix], model: BoardModel
) -> tuple[int, float | None, int]:
    """The first candidate that is a board on the path of the others; if none is, the first.

    Returns:
        Its number; standard deviations by which it lies beside the path, None if there is none; points that it needs.
    """
    judged: list[tuple[int, float | None, int]] = []
    for number, candidate in enumerate(candidates):
        if judged and not is_board(candidate.fix, model, _ON_PATH_POINTS):
            continue
        path = off_path(candidate, others)
        judged.append((number, path, LEAST_POINTS if path is None or path >= _OFF_PATH else _ON_PATH_POINTS))
        if (path or 0.0) < _OFF_PATH and is_board(candidate.fix, model, judged[-1][2]):
            return judged[-1]
    return judged[0]


def is_board(fix: Fix, model: BoardModel, least_points: int) -> bool:
    """Whether the rays agree with a board that rests on so many returns."""
    w, (mean, spread) = fix.plane.w, model.tilt
    upright = fix.plane.telling or abs(-w[2] / w[0] - mean) < _LEAN * spread
    enough = fix.support >= _LEAST_SUPPORT and fix.plane.points >= least_points
    return upright and enough and fix.explained


def vertex_of(
    index: int, time_ns: int, fix: Fix, flags: tuple[str, ...], options: Options, model: BoardModel
) -> Vertex:
    """Return the vertex of sweep ``index``; its corners, too, if the board's size is stated."""
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
