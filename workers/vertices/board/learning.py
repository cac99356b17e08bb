"""Learn a recording's sensor, its board and the person who carries it from the near sweeps.

First the planes of near sweeps teach the noise, then the boards in them teach size, edges and roll. All of this comes
from a fixed selection of sweeps spread over the whole recording, so it is the same however the recording is cut into
shards.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from apexcal.documents.detectors import Options
from workers.vertices.board.candidate import TRUNK_M, Plane, PlaneCandidate
from workers.vertices.board.candidate_search import find_planes, open_windows
from workers.vertices.board.edge_learning import (
    first_blooming,
    fitting_on_board,
    learn_board,
    learn_size,
    learn_wrong,
)
from workers.vertices.board.estimate import estimate_board
from workers.vertices.board.model import BoardModel, any_roll
from workers.vertices.board.plane_learning import (
    BIAS_M,
    ENOUGH,
    FIRST_SIGMA_M,
    MIN_RINGS,
    learn_planes,
    learn_scattered,
    likeliest_candidates,
)
from workers.vertices.board.size import BEAM_SIGMA_RAD, BLOOMING_RAD
from workers.vertices.board.upright_rectangle import is_likelier_than_upright, rim_rad
from workers.vertices.motion import jumps
from workers.vertices.range_image import RangeImage
from workers.vertices.sensor_grid import some_grid
from workers.vertices.sweep_source import Area, SweepSource, spread
from workers.vertices.vertex import SizeFacts

_GRID_SWEEPS = 24
_SWEEPS = 96
_NEAR, _NEAR_OPEN = 24, 32  # boards at many distances separate an open size from blooming
_SCATTERED = 8  # sweeps without rings
_MIN_POINTS = 12
_SHOWN, _SHOWN_OPEN = 0.4, 0.5  # share of the near planes; persons without a board show 8 of 24, and 11 of 26


def learn(source: SweepSource, area: Area, options: Options, on_sweep: Callable[[], None]) -> BoardModel | None:
    """Return the model of a recording, with defaults for what its near sweeps do not show.

    Return None if the size is not stated and fewer boards than `ENOUGH` show it.
    """
    up = np.array([options["up_x"], options["up_y"], options["up_z"]])
    grid = some_grid(source, _GRID_SWEEPS, up if up.any() else None)
    edges = (float(options["board_width_m"]), float(options["board_height_m"]))
    is_blooming_open = float(options["edge_growth_mrad"]) < 0.0
    default = BoardModel(grid, upper_corner=int(options["upper_corner"]))
    model = _with_stated(replace(default, sigma=FIRST_SIGMA_M), edges, float(options["edge_growth_mrad"]))
    if grid.scattered:
        if not all(edges):
            return None
        sweeps = [source.sweep(index) for index in spread(len(source), _SCATTERED)]
        windows = [window for sweep in sweeps for window in open_windows(sweep, area.inside(sweep), grid)]
        model = learn_scattered(windows, replace(model, is_posed=True, is_shown=True))
        model, planes = replace(model, softness=BEAM_SIGMA_RAD), _planes(windows, model)
        estimates = [estimate_board(plane, model, coarse=True) for plane in planes]
        rims = [
            rim_rad(board)
            for board in estimates
            if board is not None and board.is_trustworthy and is_likelier_than_upright(board, model)
        ]
        if is_blooming_open and rims:
            blooming, end = np.clip(np.median(rims, axis=0), 0.0, BLOOMING_RAD[1]).tolist()
            model = replace(model, blooming=blooming, softness=max(end - blooming, BEAM_SIGMA_RAD))
        model = replace(model, blooming_sigma=is_blooming_open * BEAM_SIGMA_RAD)
        return learn_wrong(planes, model)
    near: list[tuple[int, int, RangeImage]] = []
    places: list[tuple[int, float, float]] = []
    for index in spread(len(source), _SWEEPS):
        sweep = source.sweep(index)
        on_sweep()
        for candidate in find_planes(open_windows(sweep, area.inside(sweep), grid), model, 1):
            plane = candidate.plane
            if (
                plane.extent.rings >= MIN_RINGS
                and plane.extent.points >= _MIN_POINTS
                and not plane.extent.is_like_a_person
            ):
                near.append((plane.extent.points, index, candidate.window))
                places.append((sweep.stamp_ns, *_place(candidate)))
    model = replace(model, is_posed=jumps(places))
    windows = [
        window
        for _, _, window in sorted(near, key=lambda item: (-item[0], item[1]))[: _NEAR if all(edges) else _NEAR_OPEN]
    ]
    if len(windows) < ENOUGH:
        if not all(edges):
            return None
        model = replace(model, sigma=default.sigma, bias=BIAS_M, blooming_sigma=is_blooming_open * BEAM_SIGMA_RAD)
        return replace(model, is_shown=_is_shown(_planes(windows, model), model, edges))
    model, candidates = learn_planes(windows, model)
    planes = [candidate.plane for candidate in candidates]
    if not all(edges):
        if len(planes) < ENOUGH:
            return None
        model, size_estimate = learn_size(planes, model, edges, is_blooming_open)
        return _with_board(planes, model, edges, False, size_estimate.facts(edges))
    solid = [plane for plane in planes if plane.extent.has_many_rings]
    size: SizeFacts | None = None
    # On few rings a plane may hold a board and a body.
    if len(solid) >= ENOUGH:
        as_seen = replace(model, edges=default.edges, slack=default.slack, roll=default.roll)
        as_seen, size_estimate = learn_size(solid, as_seen, (0.0, 0.0), is_blooming_open, edges)
        size = size_estimate.facts(edges)
        # With a wrong size apexes are wrong by decimetres. But a door is no board of another size.
        if size.replaces:
            as_seen = _with_board(planes, as_seen, (0.0, 0.0), False, size)
            if as_seen.is_shown:
                return as_seen
            size = None
        elif is_blooming_open:
            model = first_blooming(solid, model, as_seen)
    return _with_board(planes, model, edges, is_blooming_open, size)


def _with_board(
    planes: Sequence[Plane],
    model: BoardModel,
    edges: tuple[float, float],
    is_blooming_open: bool,
    size: SizeFacts | None,
) -> BoardModel:
    """Return the model with what boards of these edges teach, and with their size if the sweeps show boards."""
    learned = replace(learn_board(planes, model, is_blooming_open), size=size)
    is_shown = _is_shown(planes, learned, edges)
    return replace(learned, is_shown=is_shown, size=size if is_shown else None)


def _planes(windows: Sequence[RangeImage], model: BoardModel) -> list[Plane]:
    return [candidate.plane for candidate in likeliest_candidates(windows, model)]


def _is_shown(planes: Sequence[Plane], model: BoardModel, edges: tuple[float, float]) -> bool:
    """Return whether near sweeps' planes are boards: four that many rings meet, or a large share of the planes.

    If many rings meet some planes that fit on the board, only these planes count. A board of unknown size must be
    wider than a person, on many rings less two standard deviations. Planes rougher than a sensor's noise are no
    boards.
    """
    many_ringed = [plane for plane in fitting_on_board(planes, edges) if plane.extent.has_many_rings]
    sigma = model.size.sigma_m[0] if model.size is not None and many_ringed else 0.0
    if (not all(edges) and min(model.edges) + 2.0 * sigma < TRUNK_M) or model.bias > 2.0 * BIAS_M:
        return False
    some = many_ringed or planes
    estimates = [board for plane in some if (board := estimate_board(plane, model, coarse=True)) is not None]
    boards = sum(board.is_trustworthy and is_likelier_than_upright(board, model) for board in estimates)
    least = (_SHOWN if all(edges) else _SHOWN_OPEN) * len(some)
    return boards >= max(least, 1) or (some is many_ringed and boards >= ENOUGH)


def _place(candidate: PlaneCandidate) -> tuple[float, float]:
    """Return x and y (m) of the middle of the plane's points. A window's own middle would move with its cells."""
    window, ends = candidate.window, candidate.ends
    runs = [(r, slice(first, last + 1)) for r, (first, last) in enumerate(ends.tolist()) if first >= 0]
    azimuth, slope, distance = (
        np.concatenate([part[run] for run in runs]) for part in (window.azimuth, window.slope, window.distance)
    )
    points = np.array([np.cos(azimuth), np.sin(azimuth), slope]) * distance
    x, y, _ = (window.R_window_lidar.T @ points[:, distance > 0.0].mean(axis=1)).tolist()
    return x, y


def _with_stated(model: BoardModel, edges: tuple[float, float], growth_mrad: float) -> BoardModel:
    if all(edges):
        model = replace(model, edges=edges, slack=0.0, roll=any_roll(edges, model.upper_corner))
    return replace(model, blooming=max(growth_mrad, 0.0) * 1e-3)
