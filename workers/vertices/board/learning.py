"""What a recording's near sweeps tell of its sensor, its board and the person who carries it.

Everything comes from a fixed selection of sweeps spread over the whole recording, so that it is the same however the
recording is cut into shards.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from apexcal.documents.detectors import Options
from workers.vertices.board.edge_learning import first_growth, learn_board, learn_size, learn_wrong, no_taller
from workers.vertices.board.estimate import locate
from workers.vertices.board.model import TRUNK_M, BoardModel, Plane, Sighting, any_roll
from workers.vertices.board.plane_learning import (
    BIAS_M,
    ENOUGH,
    FIRST_SIGMA_M,
    MIN_RINGS,
    best_sightings,
    learn_planes,
    learn_scattered,
)
from workers.vertices.board.sightings import find_planes, open_windows
from workers.vertices.board.size import BEAM_SIGMA_RAD, GROWTH_RAD
from workers.vertices.board.surroundings import likelier_than_upright, rim
from workers.vertices.motion import jumps
from workers.vertices.range_image import RangeImage
from workers.vertices.sensor_grid import some_grid
from workers.vertices.sweep_source import Area, SweepSource, spread
from workers.vertices.vertex import SizeFacts

_GRID_SWEEPS = 24
_SWEEPS = 96
_NEAR, _NEAR_OPEN = 24, 32  # an open size and the edges' growth are told apart by boards at many distances
_SCATTERED = 8  # sweeps without rings
_MIN_POINTS = 12
_SHOWN, _SHOWN_OPEN = 0.4, 0.5  # share of the near planes; persons without a board show 8 of 24, and 11 of 26


def learn(source: SweepSource, area: Area, options: Options, on_sweep: Callable[[], None]) -> BoardModel | None:
    """Return the model of a recording, with defaults where its near sweeps tell nothing.

    None if the size is not stated and fewer boards than `ENOUGH` tell it.
    """
    up = np.array([options["up_x"], options["up_y"], options["up_z"]])
    grid = some_grid(source, _GRID_SWEEPS, up if up.any() else None)
    edges = (float(options["board_width_m"]), float(options["board_height_m"]))
    is_growth_open = float(options["edge_growth_mrad"]) < 0.0
    default = BoardModel(grid, upper_corner=int(options["upper_corner"]))
    model = _given(replace(default, sigma=FIRST_SIGMA_M), edges, float(options["edge_growth_mrad"]))
    if grid.scattered:
        if not all(edges):
            return None
        sweeps = [source.sweep(index) for index in spread(len(source), _SCATTERED)]
        windows = [window for sweep in sweeps for window in open_windows(sweep, area.inside(sweep), grid)]
        model = learn_scattered(windows, replace(model, poses=True, shown=True))
        model, planes = replace(model, soft=BEAM_SIGMA_RAD), _planes(windows, model)
        fixes = [locate(plane, model, coarse=True) for plane in planes]
        rims = [
            rim(fix) for fix in fixes if fix is not None and fix.trustworthy and likelier_than_upright(fix, model)
        ]
        if is_growth_open and rims:
            growth, end = np.clip(np.median(rims, axis=0), 0.0, GROWTH_RAD[1]).tolist()
            model = replace(model, growth=growth, soft=max(end - growth, BEAM_SIGMA_RAD))
        model = replace(model, growth_sigma=is_growth_open * BEAM_SIGMA_RAD)
        return learn_wrong(planes, model)
    near: list[tuple[int, int, RangeImage]] = []
    places: list[tuple[int, float, float]] = []
    for index in spread(len(source), _SWEEPS):
        sweep = source.sweep(index)
        on_sweep()
        for sighting in find_planes(open_windows(sweep, area.inside(sweep), grid), model, 1):
            plane = sighting.plane
            if plane.rings >= MIN_RINGS and plane.points >= _MIN_POINTS and not plane.like_a_person:
                near.append((plane.points, index, sighting.window))
                places.append((sweep.stamp_ns, *_place(sighting)))
    model = replace(model, poses=jumps(places))
    windows = [
        window
        for _, _, window in sorted(near, key=lambda item: (-item[0], item[1]))[: _NEAR if all(edges) else _NEAR_OPEN]
    ]
    if len(windows) < ENOUGH:
        if not all(edges):
            return None
        model = replace(model, sigma=default.sigma, bias=BIAS_M, growth_sigma=is_growth_open * BEAM_SIGMA_RAD)
        return replace(model, shown=_shown(_planes(windows, model), model, edges))
    model, sightings = learn_planes(windows, model)
    planes = [sighting.plane for sighting in sightings]
    if not all(edges):
        if len(planes) < ENOUGH:
            return None
        model, estimate = learn_size(planes, model, edges, is_growth_open)
        return _with_board(planes, model, edges, False, estimate.facts(edges))
    solid = [plane for plane in planes if plane.telling]
    size: SizeFacts | None = None
    # On few rings a plane may be a board and a body.
    if len(solid) >= ENOUGH:
        as_seen = replace(model, edges=default.edges, slack=default.slack, roll=default.roll)
        as_seen, estimate = learn_size(solid, as_seen, (0.0, 0.0), is_growth_open, edges)
        size = estimate.facts(edges)
        # Apexes that are measured with a wrong size are wrong by decimetres; doors are no boards of another size.
        if size.replaces:
            as_seen = _with_board(planes, as_seen, (0.0, 0.0), False, size)
            if as_seen.shown:
                return as_seen
            size = None
        elif is_growth_open:
            model = first_growth(solid, model, as_seen)
    return _with_board(planes, model, edges, is_growth_open, size)


def _with_board(
    planes: Sequence[Plane],
    model: BoardModel,
    edges: tuple[float, float],
    is_growth_open: bool,
    size: SizeFacts | None,
) -> BoardModel:
    """Return the model with all that is learned of a board of its edges, and its size if boards are shown."""
    learned = replace(learn_board(planes, model, is_growth_open), size=size)
    shown = _shown(planes, learned, edges)
    return replace(learned, shown=shown, size=size if shown else None)


def _planes(windows: Sequence[RangeImage], model: BoardModel) -> list[Plane]:
    return [sighting.plane for sighting in best_sightings(windows, model)]


def _shown(planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float]) -> bool:
    """Whether near sweeps' planes are boards: four that many rings meet, or a large share of the planes.

    If many rings meet some planes that fit on the board, only these count. A board of unknown size must be wider than
    a person, where many rings meet it within two standard deviations. Planes that are less even than sensors are show
    no board.
    """
    telling = [plane for plane in no_taller(planes, edges) if plane.telling]
    sigma = model.size.sigma_m[0] if model.size is not None and telling else 0.0
    if (not all(edges) and min(model.edges) + 2.0 * sigma < TRUNK_M) or model.bias > 2.0 * BIAS_M:
        return False
    some = telling or planes
    fixes = [fix for plane in some if (fix := locate(plane, model, coarse=True)) is not None]
    boards = sum(fix.trustworthy and likelier_than_upright(fix, model) for fix in fixes)
    least = (_SHOWN if all(edges) else _SHOWN_OPEN) * len(some)
    return boards >= max(least, 1) or (some is telling and boards >= ENOUGH)


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
        model = replace(model, edges=edges, slack=0.0, roll=any_roll(edges, model.upper_corner))
    return replace(model, growth=max(growth_mrad, 0.0) * 1e-3)
