"""What a recording's near sweeps tell of its sensor, its board and the person who carries it.

Everything comes from a fixed selection of sweeps spread over the whole recording, so that it is the same however the
recording is cut into shards.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from apexcal.documents.detectors import Options
from workers.vertices.jumps import jumps
from workers.vertices.refined.board import find_planes, locate, open_windows
from workers.vertices.refined.board_learning import evidence, learn_board, mean_reach, no_taller, some_edges
from workers.vertices.refined.board_model import TRUNK_M, BoardModel, Plane, Sighting, any_roll
from workers.vertices.refined.growth import BEAM_SIGMA_RAD
from workers.vertices.refined.plane_learning import (
    BIAS_M,
    ENOUGH,
    FIRST_SIGMA_M,
    MIN_RINGS,
    best_sightings,
    learn_planes,
)
from workers.vertices.refined.size import doubtful, growth_spread, other_size
from workers.vertices.refined.track import trustworthy
from workers.vertices.refined.upright import likelier_than_upright
from workers.vertices.refined.window import RangeImage
from workers.vertices.sensor_grid import learn_grid
from workers.vertices.sweep_source import Area, SweepSource

_GRID_SWEEPS = 24
_SWEEPS = 96
_NEAR, _NEAR_OPEN = 24, 32  # an open size and the edges' growth are told apart by boards at many distances
_MIN_POINTS = 12
_SHOWN, _SHOWN_OPEN = 0.4, 0.5  # share of the near planes; persons without a board show 8 of 24, and 11 of 26


def learn(source: SweepSource, area: Area, options: Options, on_sweep: Callable[[], None]) -> BoardModel:
    """The model of a recording; defaults where its near sweeps tell nothing."""
    up = np.array([options["up_x"], options["up_y"], options["up_z"]])
    some = (source.sweep(index) for index in _spread(len(source), _GRID_SWEEPS))
    grid = learn_grid(some, up if up.any() else None)
    edges = (float(options["board_width_m"]), float(options["board_height_m"]))
    model = _given(BoardModel(grid, sigma=FIRST_SIGMA_M), edges, float(options["edge_growth_mrad"]))
    near: list[tuple[int, int, RangeImage]] = []
    places: list[tuple[int, float, float]] = []
    for index in _spread(len(source), _SWEEPS):
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
        open_growth = BEAM_SIGMA_RAD if float(options["edge_growth_mrad"]) < 0.0 else 0.0
        model = replace(model, sigma=BoardModel(grid).sigma, bias=BIAS_M, growth_sigma=open_growth)
        if not all(edges):
            model = some_edges(_planes(windows, model), model, edges)
        return replace(model, shown=_shown(_planes(windows, model), model, edges))
    model, sightings = learn_planes(windows, model)
    planes = [sighting.plane for sighting in sightings]
    growth_mrad = float(options["edge_growth_mrad"])
    learned = learn_board(planes, model, edges, growth_mrad)
    learned = replace(learned, shown=_shown(planes, learned, edges))
    if len(planes) < ENOUGH or not all(edges) or not doubtful(planes, learned, mean_reach(planes)):
        return learned
    default = BoardModel(model.grid)
    as_seen = replace(model, edges=default.edges, slack=default.slack, roll=default.roll)
    open_size = learn_board(planes, as_seen, (0.0, 0.0), growth_mrad)
    open_size = replace(open_size, shown=_shown(planes, open_size, (0.0, 0.0)))
    # Doors and cars are no boards of another size.
    size = other_size(edges, open_size, mean_reach(planes)) if open_size.shown else None
    if size is None or _likelihood(planes, open_size) < _likelihood(planes, learned):
        return learned
    # Apexes that are found with a wrong size are wrong by decimetres.
    return replace(open_size, size=size)


def _planes(windows: Sequence[RangeImage], model: BoardModel) -> list[Plane]:
    return [sighting.plane for sighting in best_sightings(windows, model)]


def _likelihood(planes: Sequence[Plane], model: BoardModel) -> float:
    """Log evidence of a model, whose growth is as likely as the step at the edges makes it."""
    unusual = (model.growth - model.soft) / growth_spread(model.soft)
    return evidence(planes, model) - 0.5 * unusual**2


def _shown(planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float]) -> bool:
    """Whether near sweeps' planes are boards: four that many rings meet, or a large share of the planes.

    If many rings meet some planes that fit on the board, only these count. A board of unknown size must be wider than
    a person. Planes that are less even than sensors are show no board.
    """
    if (not all(edges) and min(model.edges) < TRUNK_M) or model.bias > 2.0 * BIAS_M:
        return False
    telling = [plane for plane in no_taller(planes, edges) if plane.telling]
    some = telling or planes
    fixes = [fix for plane in some if (fix := locate(plane, model, coarse=True)) is not None]
    boards = sum(trustworthy(fix) and likelier_than_upright(fix, model) for fix in fixes)
    least = (_SHOWN if all(edges) else _SHOWN_OPEN) * len(some)
    return boards >= max(least, 1) or (some is telling and boards >= ENOUGH)


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
