"""The likeliest board of a sweep, without a region and with nothing learned: for suggesting a region."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.readers.recording import Sweep
from workers.vertices.refined.board import find_planes, locate, open_windows
from workers.vertices.refined.board_model import TRUNK_M, BoardModel, Fix
from workers.vertices.sensor_grid import SensorGrid
from workers.vertices.upright_pieces import upright_pieces

Mask = NDArray[np.bool_]

_SIGMA_M: Final = 0.03  # data sheets of spinning sensors
# Boards that are sold for calibration or as panels have edges of 0.4 to 1.4 m; two sizes and their slack cover that.
_SIZES_M: Final = ((0.9, 1.2), (0.6, 0.8))
_SLACK_M: Final = 0.2
_LEAST_SUPPORT: Final = 8.0  # as of a vertex: ten candidates in 200 sweeps give no false board
_FEWEST_POINTS: Final = 12
# Of a board by its shape alone. Chosen on simulated poses (`tests.support.scenes.still`, seeds 50 to 57):
# boards had at most 0.04 and 0.15 degrees, one had 0.49. Walls, cars and people had more of one of the two.
_CONTRADICTED: Final = 0.05
_MOST_SIGMA: Final = math.radians(0.5)
_MOST_PIECES: Final = 40
_PLANES: Final = 3  # of each group of points that stand together


@dataclass(frozen=True, slots=True, eq=False)
class LikelyBoard:
    """A board: its apex (3,), metres, how likely it is, and whether enough rings meet it to tell it from a person."""

    apex: NDArray[np.float64]
    support: float
    telling: bool


def search(sweep: Sweep, chosen: Mask, grid: SensorGrid, *, sure: bool) -> LikelyBoard | None:
    """The likeliest board among the points ``chosen`` (N,) of a sweep; None if nothing is like one.

    Args:
        sure: whether the rays must agree with a board and determine its apex. They need not where only a board and
            people can be among the points.
    """
    short, other = _SIZES_M[0]
    model = BoardModel(grid, sigma=_SIGMA_M, edges=(short, other), slack=_SLACK_M)
    best: LikelyBoard | None = None
    windows = open_windows(sweep, chosen, grid)
    sightings = [sighting for window in windows for sighting in find_planes([window], model, _PLANES)]
    for plane in (sighting.plane for sighting in sightings):
        if plane.points < _FEWEST_POINTS or plane.width < TRUNK_M:
            continue
        for edges in _SIZES_M:
            fix = locate(plane, replace(model, edges=edges), coarse=True)
            if fix is None or fix.support < _LEAST_SUPPORT:
                continue
            if sure and not _certain(fix):
                continue
            if best is None or fix.support > best.support:
                best = LikelyBoard(fix.xyz, fix.support, plane.telling)
    return best


def _certain(fix: Fix) -> bool:
    contradicted = fix.against / (fix.plane.points + fix.against)
    return fix.explained and fix.sigma < _MOST_SIGMA and contradicted < _CONTRADICTED


def search_everywhere(sweep: Sweep, grid: SensorGrid) -> LikelyBoard | None:
    """The likeliest board of a whole sweep, by its own shape alone."""
    pieces = upright_pieces(sweep, np.ones(len(sweep.xyz), np.bool_), grid)[:_MOST_PIECES]
    boards = [board for piece in pieces if (board := search(sweep, piece, grid, sure=True)) is not None]
    return max(boards, key=lambda board: (board.telling, board.support), default=None)
