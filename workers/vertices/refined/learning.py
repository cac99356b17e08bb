"""What a recording's near sweeps tell of its sensor, its board and the person who carries it.

Everything comes from a fixed selection of sweeps spread over the whole recording, so that it is the same however the
recording is cut into shards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.detectors import Options
from workers.vertices.jumps import jumps
from workers.vertices.refined.board import find_planes, inside_of, locate, open_windows, weigh
from workers.vertices.refined.board_model import EDGE_M, TRUNK_M, BoardModel, Floats, Plane, Sighting, any_roll
from workers.vertices.refined.growth import (
    BEAM_SIGMA_RAD,
    GROWTH_RAD,
    SOFT_DEG,
    any_growth,
    likely_growth,
    usual_steps,
)
from workers.vertices.refined.holding import learn_roll, learn_slope
from workers.vertices.refined.planes import fit_plane
from workers.vertices.refined.rays import WRONG
from workers.vertices.refined.ring_errors import MANY_RINGS, Spread, spread_about
from workers.vertices.refined.size import doubtful, growth_spread, other_size
from workers.vertices.refined.track import trustworthy
from workers.vertices.refined.upright import likelier_than_upright
from workers.vertices.refined.window import Window
from workers.vertices.sensor_grid import learn_grid
from workers.vertices.sweep_source import Area, SweepSource

_GRID_SWEEPS = 24
_SWEEPS = 96
_NEAR, _NEAR_OPEN = 24, 32  # an open size and the edges' growth are told apart by boards at many distances
_ENOUGH = 4  # near sweeps from which something is learned
_MIN_RINGS, _MIN_POINTS = 2, 12
_DEVIATIONS = 4.0  # points farther off a plane are not of it
_FIRST_SIGMA_M = 0.03
_SIGMA_M = (0.004, 0.08)
_ANY_TILT = (0.0, 0.25)  # boards held on their tip lean by slopes up to 0.7 (real recordings); 2.8 deviations
_LEAST_TILT, _LEAST_YAW = 0.03, 0.1
_LENGTHS_M = (0.36 * 1.15 ** np.arange(10)).tolist()
_FIRST, _SOME = 5, 10
_HOPELESS = -300.0
_WIDE_ROLL = math.radians(12.0)  # the grid reaches 2.8 deviations: 34 degrees
_GROWTHS_RAD = (0.0, 1.0e-3, 2.0e-3, 4.0e-3, 8.0e-3)
_INSETS_RAD = (0.25e-3 * np.arange(1, 21)).tolist()  # beams are up to 10 mrad wide
_BIAS_M = 0.015  # data sheets: accuracy 0.03 m, as two standard deviations
_MOST_WRONG = 0.45  # from one half on, a return would speak for the other side of an edge


def learn(source: SweepSource, area: Area, options: Options, on_sweep: Callable[[], None]) -> BoardModel:
    """The model of a recording; defaults where its near sweeps tell nothing."""
    up = np.array([options["up_x"], options["up_y"], options["up_z"]])
    some = (source.sweep(index) for index in _spread(len(source), _GRID_SWEEPS))
    grid = learn_grid(some, up if up.any() else None)
    edges = (float(options["board_width_m"]), float(options["board_height_m"]))
    model = _given(BoardModel(grid, sigma=_FIRST_SIGMA_M), edges, float(options["edge_growth_mrad"]))
    near: list[tuple[int, int, Window]] = []
    places: list[tuple[int, float, float]] = []
    for index in _spread(len(source), _SWEEPS):
        sweep = source.sweep(index)
        on_sweep()
        for sighting in find_planes(open_windows(sweep, area.inside(sweep), grid), model, 1):
            plane = sighting.plane
            if plane.rings >= _MIN_RINGS and plane.points >= _MIN_POINTS and not plane.like_a_person:
                near.append((plane.points, index, sighting.window))
                places.append((sweep.stamp_ns, *_place(sighting)))
    model = replace(model, poses=jumps(places))
    windows = [
        window
        for _, _, window in sorted(near, key=lambda item: (-item[0], item[1]))[: _NEAR if all(edges) else _NEAR_OPEN]
    ]
    if len(windows) < _ENOUGH:
        open_growth = BEAM_SIGMA_RAD if float(options["edge_growth_mrad"]) < 0.0 else 0.0
        model = replace(model, sigma=BoardModel(grid).sigma, bias=_BIAS_M, growth_sigma=open_growth)
        model = model if all(edges) else _some_edges(windows, model, edges)
        return replace(model, shown=_shown([sighting.plane for sighting in _best(windows, model)], model, edges))
    model, sightings = _learn_planes(windows, model)
    planes = [sighting.plane for sighting in sightings]
    growth_mrad = float(options["edge_growth_mrad"])
    learned = _learn_board(planes, model, edges, growth_mrad)
    learned = replace(learned, shown=_shown(planes, learned, edges))
    if len(planes) < _ENOUGH or not all(edges) or not doubtful(planes, learned, _mean_reach(planes)):
        return learned
    default = BoardModel(model.grid)
    as_seen = replace(model, edges=default.edges, slack=default.slack, roll=default.roll)
    seen = _learn_board(planes, as_seen, (0.0, 0.0), growth_mrad)
    seen = replace(seen, shown=_shown(planes, seen, (0.0, 0.0)))
    # Doors and cars are no boards of another size.
    size = other_size(edges, seen, _mean_reach(planes)) if seen.shown else None
    if size is None or _likelihood(planes, seen) < _likelihood(planes, learned):
        return learned
    # Apexes that are found with a wrong size are wrong by decimetres.
    return replace(seen, size=size)


def _likelihood(planes: Sequence[Plane], model: BoardModel) -> float:
    """Log evidence of a model, whose growth is as likely as the step at the edges makes it."""
    unusual = (model.growth - model.soft) / growth_spread(model.soft)
    return _evidence(planes, model) - 0.5 * unusual**2


def _shown(planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float]) -> bool:
    """Whether near sweeps' planes are boards: four that many rings meet, or at least half of the planes.

    If many rings meet some planes that fit on the board, only these count. A board of unknown size that is no wider
    than a person is not told from one, and what is less even than sensors are is no board.
    """
    if (not all(edges) and min(model.edges) < TRUNK_M) or model.bias > 2.0 * _BIAS_M:
        return False
    telling = [plane for plane in _no_taller(planes, edges) if plane.telling]
    some = telling or planes
    fixes = [fix for plane in some if (fix := locate(plane, model, coarse=True)) is not None]
    boards = sum(trustworthy(fix) and likelier_than_upright(fix, model) for fix in fixes)
    return 0 < len(some) <= 2 * boards or (some is telling and boards >= _ENOUGH)


def _spread(count: int, most: int) -> list[int]:
    """At most ``most`` of the numbers 0 to count - 1, evenly spread."""
    return sorted({int(i) for i in np.linspace(0, count - 1, min(most, count)).round()}) if count else []


def _place(sighting: Sighting) -> tuple[float, float]:
    """Where the middle of the plane's points stands, x and y in metres; a window's middle moves with its cells."""
    window, ends = sighting.window, sighting.ends
    runs = [(r, slice(first, last + 1)) for r, (first, last) in enumerate(ends.tolist()) if first >= 0]
    azimuth, slope, distance = (
        np.concatenate([part[run] for run in runs]) for part in (window.azimuth, window.slope, window.distance)
    )
    points = np.array([np.cos(azimuth), np.sin(azimuth), slope]) * distance
    x, y, _ = (window.R_window_lidar.T @ points[:, distance > 0.0].mean(axis=1)).tolist()
    return x, y


def _given(model: BoardModel, edges: tuple[float, float], growth_mrad: float) -> BoardModel:
    if all(edges):
        model = replace(model, edges=edges, slack=0.0, roll=any_roll(edges))
    return replace(model, growth=max(growth_mrad, 0.0) * 1e-3)


def _learn_planes(windows: Sequence[Window], model: BoardModel) -> tuple[BoardModel, list[Sighting]]:
    """The noise of the distances, and how upright the board is held."""
    sightings = _best(windows, model)
    noise = _noise(sightings)
    default = BoardModel(model.grid)
    model = replace(model, sigma=_clip(noise), lost=_lost(sightings, default.lost))
    for _ in range(3):
        sightings = _best(windows, model)
        if len(sightings) < _ENOUGH:
            return model, sightings
        upper = [_upper_part(sighting, model) for sighting in sightings]
        # Larger ones are no planes.
        about = [part[2] for part in upper if part[2] is not None and part[2].own(noise) < _SIGMA_M[1]]
        spread = rings = bias = 0.0
        if len(about) >= _ENOUGH:
            # Rings differ: the spread about the plane holds that, the second differences do not.
            spread = float(np.median([part.own(noise) for part in about]))
            within = float(np.median([part.within for part in about]))
            rings = math.sqrt(max(float(np.median([part.between for part in about])), 0.0))
            # A bend of the board is an error that neighbours share, too.
            bias = math.hypot(math.sqrt(max(within - noise**2, 0.0)), rings)
        if sum(sighting.plane.telling for sighting in sightings) < _ENOUGH:
            # On few rings a plane may have met the body, too.
            spread, rings, bias = (min(value, _BIAS_M) for value in (spread, rings, bias))
        slopes, variances = (np.array([part[k] for part in upper]) for k in (0, 1))
        turn = learn_slope(slopes[:, 0], variances[:, 0], default.yaw, default.yaw, _LEAST_YAW)
        model = replace(
            model,
            sigma=_clip(math.hypot(noise, spread)),
            ring_bias=rings,
            bias=bias,
            tilt=learn_slope(slopes[:, 1], variances[:, 1], _ANY_TILT, default.tilt, _LEAST_TILT),
            yaw=(0.0, max(2.0 * turn[1], 0.2)),
        )
    return model, _best(windows, model)


def _upper_part(sighting: Sighting, model: BoardModel) -> tuple[Floats, Floats, Spread | None]:
    """The plane's two slopes, their variances, and the spread about it.

    It is fitted to the rings that are nearly as wide as the widest; where these are few, to the next above them, too.
    Farther down a ring may have met the body, and farther up a head: both are only centimetres behind the board.
    """
    window, ends = sighting.window, sighting.ends
    rings = np.flatnonzero(ends[:, 0] >= 0)
    width = {r: abs(window.azimuth[r, ends[r, 1]] - window.azimuth[r, ends[r, 0]]) for r in rings}
    widest = max(rings, key=lambda r: width[r])
    wide = [r for r in rings if width[r] > 0.6 * width[widest]]
    above = [r for r in rings if r > widest and r not in wide]
    kept = [*wide, *above[: max(MANY_RINGS - len(wide), 0)]]
    runs = [(r, slice(ends[r, 0], ends[r, 1] + 1)) for r in kept]
    azimuth, slope, distance = (
        np.concatenate([part[run] for run in runs]) for part in (window.azimuth, window.slope, window.distance)
    )
    on_it = np.abs(_beyond(azimuth, slope, distance, sighting.plane.w)) < _DEVIATIONS * model.sigma
    azimuth, slope, distance = azimuth[on_it], slope[on_it], distance[on_it]
    prior = np.array([*BoardModel(model.grid).yaw, *_ANY_TILT])
    w, info = fit_plane(azimuth, slope, distance, np.ones(distance.size), model.sigma, prior)
    towards = np.column_stack([w[1:] / w[0] ** 2, -np.eye(2) / w[0]])
    variances: Floats = np.asarray(np.diag(towards @ np.linalg.inv(info) @ towards.T), np.float64)
    ring = np.repeat(np.arange(len(runs)), [run.stop - run.start for _, run in runs])[on_it]
    return -w[1:] / w[0], variances, spread_about(_beyond(azimuth, slope, distance, w), ring)


def _beyond(azimuth: Floats, slope: Floats, distance: Floats, w: Floats) -> Floats:
    """Horizontal metres by which points lie behind a plane."""
    return distance - 1.0 / (w[0] * np.cos(azimuth) + w[1] * np.sin(azimuth) + w[2] * slope)


def _best(windows: Sequence[Window], model: BoardModel) -> list[Sighting]:
    sightings = [sighting for window in windows for sighting in find_planes([window], model, 1)]
    return [sighting for sighting in sightings if sighting.plane.rings >= _MIN_RINGS]


def _runs(sighting: Sighting) -> list[Floats]:
    """Distances along the board's part of every ring, 0 where nothing came back."""
    ends = enumerate(sighting.ends.tolist())
    return [sighting.window.distance[r, first : last + 1] for r, (first, last) in ends if first >= 0]


def _noise(sightings: Sequence[Sighting]) -> float:
    """From second differences along the rings, which a plane and a slow bend do not change."""
    runs = [run for sighting in sightings for run in _runs(sighting)]
    second = np.concatenate([np.zeros(0), *(np.diff(run[run > 0.0], 2) for run in runs)])
    return 1.4826 * float(np.median(np.abs(second))) / math.sqrt(6.0) if second.size else _FIRST_SIGMA_M


def _lost(sightings: Sequence[Sighting], default: float) -> float:
    """Share of the rays on the board without a return; a hundred imagined rays at the default are counted in."""
    runs = [run for sighting in sightings for run in _runs(sighting)]
    missing, rays = sum(int(np.count_nonzero(run == 0.0)) for run in runs), sum(run.size for run in runs)
    return max((missing + 100.0 * default) / (rays + 100.0), default)


def _clip(sigma: float) -> float:
    return min(max(sigma, _SIGMA_M[0]), _SIGMA_M[1])


def _learn_board(
    planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float], growth_mrad: float
) -> BoardModel:
    """The board's edges where they are not given, their growth, which edge is where, and the roll."""
    planes = _no_taller(planes, edges)
    if len(planes) < _ENOUGH:
        return model
    solid = [plane for plane in planes if plane.telling]
    told = len(solid) >= _ENOUGH
    steps = usual_steps()
    if not all(edges):
        model = _first_edges(planes, model, edges)
    elif told and growth_mrad < 0.0:
        model = _first_growth(solid, model)
    for step in (1.0, 0.4):
        if told and all(edges):
            model, steps = _learn_step(solid[:_SOME], model)
        model = _refine(planes, model, edges, growth_mrad, step, steps)
        if told and all(edges):
            model = _learn_inset(solid[:_SOME], model)
        elif told:
            model = _learn_blur(solid[:_SOME], model)
        if told:
            model = _learn_wrong(solid[:_SOME], model)
        # Growth and roll are told by the same edges, so each is learned again with the other.
        model = _learn_roll(planes, model)
    return model


def _no_taller(planes: Sequence[Plane], edges: tuple[float, float]) -> Sequence[Plane]:
    """The planes whose returns fit on the board, if its size is known; the others met a body, too."""
    if not all(edges):
        return planes
    most = math.hypot(*edges)
    fit = [
        p
        for p in planes
        if p.hits.size and np.ptp(p.hits[1]) < most + 2.0 * GROWTH_RAD[1] * float(np.median(p.reach))
    ]
    return fit if len(fit) >= _ENOUGH else planes


def _first_edges(planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float]) -> BoardModel:
    """Of a coarse table of lengths those that explain the best seen boards best."""
    best = max(_table(model, edges), key=lambda candidate: _evidence(planes[:_FIRST], candidate))
    return replace(best, slack=0.0)


def _table(model: BoardModel, edges: tuple[float, float]) -> list[BoardModel]:
    """The model with each pair of lengths of a coarse table."""
    known = max(edges)
    lengths = [known] if known > 0.0 else _LENGTHS_M
    return [
        replace(model, edges=(one, other), slack=0.5 * (_LENGTHS_M[1] / _LENGTHS_M[0] - 1.0) * other)
        for one in lengths
        for other in _LENGTHS_M
        if known > 0.0 or one <= other
    ]


def _some_edges(windows: Sequence[Window], model: BoardModel, edges: tuple[float, float]) -> BoardModel:
    """What few boards tell of the edges: a mean over the table of lengths, each as likely as it explains them."""
    planes = [sighting.plane for sighting in _best(windows, model)]
    if not planes:
        return model
    tried = _table(model, edges)
    evidence = np.array([_evidence(planes, candidate) for candidate in tried])
    weight = np.exp(evidence - np.logaddexp.reduce(evidence))
    lengths = np.array([candidate.edges for candidate in tried])
    mean = weight @ lengths
    spread = np.sqrt(weight @ (lengths - mean) ** 2)
    one, other = mean.tolist()
    half_step = 0.5 * (_LENGTHS_M[1] / _LENGTHS_M[0] - 1.0) * other
    slack = min(2.0 * float(spread.max()) + half_step, model.slack)
    return replace(model, edges=(one, other), slack=slack, sizes_tried=len(tried))


def _first_growth(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """Of a coarse table of growths and widths of the step at an edge those that explain the best seen boards best."""
    tried = [
        replace(model, growth=growth, inset=max(growth, BEAM_SIGMA_RAD), soft=math.radians(deg))
        for growth in _GROWTHS_RAD
        for deg in SOFT_DEG
    ]
    return max(tried, key=lambda candidate: _evidence(planes[:_FIRST], candidate))


def _learn_blur(planes: Sequence[Plane], model: BoardModel) -> BoardModel:
    """How gradually the hits end at an edge: what explains the near sweeps best."""
    widths = [replace(model, soft=math.radians(width)) for width in SOFT_DEG]
    return max(widths, key=lambda tried: _evidence(planes, tried))


def _learn_step(planes: Sequence[Plane], model: BoardModel) -> tuple[BoardModel, Floats]:
    """How gradually the hits end at an edge: the mean; and how likely each of the table's half widths is (K,)."""
    told = np.array([_evidence(planes, replace(model, soft=math.radians(width))) for width in SOFT_DEG])
    share = usual_steps() * np.exp(told - told.max())
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


def _evidence(planes: Sequence[Plane], model: BoardModel) -> float:
    """Log evidence of a model over three quarters of the sweeps: those that it explains worst may be no boards.

    The boards' rolls have an unknown mean in common: each by itself can take the roll that suits a wrong model.
    """
    wide = _any_way(model)
    found = [weigh(plane, wide, coarse=True) for plane in planes]
    boards = sorted((held for held in found if held is not None), key=lambda held: held.evidence)
    few = len(found) // 4 - (len(found) - len(boards))
    kept = boards[max(few, 0) :]
    if not kept:
        return _HOPELESS * len(found)
    told = np.array([held.told for held in kept])
    return learn_roll(told, any_roll(model.edges)).evidence + _HOPELESS * max(-few, 0)


def _refine(
    planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float], growth_mrad: float, step: float,
    widths: Floats,
) -> BoardModel:  # fmt: skip
    """Whatever is open of edge lengths and growth, by the evidence of the near sweeps, one after the other.

    A growth makes a board larger by twice the growth times its distance; so the lengths are varied as they appear at
    the planes' mean distance, which hardly depends on the growth. With the lengths open, only boards at several
    distances tell the growth, and each of them no better than to `EDGE_M`.
    """
    reach = _mean_reach(planes)
    free = [index for index in (0, 1) if not all(edges) and model.edges[index] not in edges]
    state = np.array([*model.edges, model.growth])
    state[free] += 2.0 * reach * state[2]

    def modelled(x: Floats) -> BoardModel:
        lengths = [float(x[i] - 2.0 * reach * x[2] * (i in free)) for i in (0, 1)]
        return replace(model, edges=(lengths[0], lengths[1]), growth=float(x[2]))

    def evidence(x: Floats) -> float:
        return _evidence(planes, modelled(x))

    open_growth = growth_mrad < 0.0
    sigmas = np.zeros(3)
    steps = [0.02, 0.02, 0.5e-3]
    for index in [*free, *([2] if open_growth else [])]:
        state, sigmas[index] = _climb(evidence, state, index, steps[index] * step)
    if open_growth:
        reaches = np.array([np.median(plane.reach) for plane in planes])
        lever = float(np.std(reaches) if free else np.mean(reaches)) * math.sqrt(len(planes))
        told = state[2], math.hypot(sigmas[2], EDGE_M / max(lever, 1e-3))
        state[2], sigmas[2] = likely_growth(*told, model.soft) if free else any_growth(*told, widths)
    slack = 2.0 * float(max([sigmas[index] for index in free], default=0.0))
    return replace(modelled(state), slack=slack, growth_sigma=float(sigmas[2]))


def _mean_reach(planes: Sequence[Plane]) -> float:
    return float(np.mean([np.median(plane.reach) for plane in planes]))


def _climb(value: Callable[[Floats], float], at: Floats, index: int, step: float) -> tuple[Floats, float]:
    """Along one coordinate in even steps to the highest value, then to the parabola's top; with its width."""

    def along(k: int) -> float:
        x = at.copy()
        x[index] += k * step
        return value(x)

    known: dict[int, float] = {k: along(k) for k in (-1, 0, 1)}
    for _ in range(8):
        top = max(known, key=known.__getitem__)
        missing = [k for k in (top - 1, top + 1) if k not in known]
        if not missing:
            break
        known |= {k: along(k) for k in missing}
    top = max(known, key=known.__getitem__)
    moved = at.copy()
    before, after = known.get(top - 1), known.get(top + 1)
    bend = 2.0 * known[top] - before - after if before is not None and after is not None else 0.0
    shift = 0.5 * (after - before) / bend if bend > 0.0 and before is not None and after is not None else 0.0
    moved[index] += (top + min(max(shift, -0.5), 0.5)) * step
    return moved, step / math.sqrt(bend) if bend > 1e-9 else step
