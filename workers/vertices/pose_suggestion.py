"""The suggested region of still poses: around the likeliest board of each pose, and where it may be too small.

A pose without a visible board counts if what differs there is as near as the other poses' boards. Where nothing
differs from pose to pose, the board's own shape shows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.errors import InputError
from workers.readers.recording import Sweep
from workers.vertices.board.board_estimate import BoardEstimate
from workers.vertices.board.candidate import TRUNK_M
from workers.vertices.board.candidate_search import find_planes, open_windows
from workers.vertices.board.estimate import estimate_board
from workers.vertices.board.model import BoardModel
from workers.vertices.pose_detection import SAME_PLACE_M
from workers.vertices.region import Region
from workers.vertices.sensor_grid import SensorGrid
from workers.vertices.still_poses import StillPoses
from workers.vertices.suggested_region import (
    ObservedScene,
    Suggestion,
    Thing,
    describe,
    in_level_axes,
    upright_pieces,
)
from workers.vertices.sweep_source import SweepSource, spread

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

MARGIN_M: Final = 0.5
_BESIDE_M: Final = 1.2  # a board reaches no farther from its bearer
_MOST_EVERYWHERE: Final = 8  # sweeps searched whole
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


def largest(things: Sequence[Thing]) -> list[Thing]:
    """Return the first thing and what belongs to it, as a board belongs to a person."""
    return [thing for thing in things if np.hypot(*(thing.middle - things[0].middle)) <= _BESIDE_M]


def likeliest_board(sweep: Sweep, chosen: Mask, grid: SensorGrid) -> Floats | None:
    """Return the apex (3,) of the likeliest board among the points ``chosen`` (N,), which hold a board and people."""
    best = max(_boards(sweep, chosen, grid, sure=False), key=lambda board: board.joint_evidence, default=None)
    return None if best is None else best.xyz


def bearer_of(points: Floats, apex: Floats) -> list[Thing]:
    """Return the board and its bearer, among the moving points (N, 3)."""
    points = points[np.linalg.norm(points[:, :2] - apex[:2], axis=1) < _BESIDE_M]
    return [Thing(np.concatenate([points, apex[None]]), apex[:2])]


def around_poses(
    source: SweepSource,
    poses: StillPoses,
    chosen: Sequence[int],
    scene: ObservedScene,
    boards: Sequence[bool],
    moved: Sequence[Mask],
    level: Floats,
    report: Callable[[], None],
) -> Suggestion:
    """Return the region around the boards; a pose whose board is not seen counts if it is as near as the others'."""
    notes: list[str] = []
    if not any(scene.things):
        notes.append(
            "The board was found by its shape alone, because no other pose shows what stands there without it."
        )
        for number in spread(len(chosen), _MOST_EVERYWHERE):
            report()
            apex = _search_everywhere(source.sweep(chosen[number]), poses.grid)
            if apex is not None:
                corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.6, 0.0)])
                at = level @ apex
                scene.things[number] = [Thing(at + _BESIDE_M * corners / 2.0, at[:2])]
    else:
        places = np.array([some[0].middle for some, board in zip(scene.things, boards, strict=True) if board])
        for number, (some, board) in enumerate(zip(scene.things, boards, strict=True)):
            if not board:
                counts = 2 * len(places) < len(boards)
                scene.things[number] = [t for t in largest(some) if counts or _is_among(t.middle, places)]
    if not any(scene.things):
        raise InputError(
            "no_board_seen",
            "Nothing differs from sweep to sweep, and nothing looks like a board with a corner up.",
            "Move the board from pose to pose, hold it with a corner up within 15 m, and upload with --still; or "
            "write the region by hand.",
        )
    missing = [index for index, some in zip(chosen, scene.things, strict=True) if not some]
    if missing and not poses.single:
        notes.append(f"No board was seen in the sweeps {_listed(missing)}: the region may leave it out there.")
    if poses.walked:
        notes.append(
            "The recording was uploaded as still poses, but somebody walks in it. If it is a walk, upload it without "
            "--still. Then apexcal uses the track and the times of the points."
        )
    suggestion = describe(scene.things, scene, MARGIN_M, poses=1, notes=notes)
    region = Region.from_document(in_level_axes(suggestion, level).document)
    first = poses.grouped(source, region, report).first
    places = [some[0].middle if board else None for some, board in zip(scene.things, boards, strict=True)]
    pairs = zip(pairwise(chosen), pairwise(places), strict=True)
    count = 1 + sum(first[a] != first[b] and not _stand_together(*of_boards) for (a, b), of_boards in pairs)
    outside = [] if poses.single else boards_outside(source, chosen, moved, poses.grid, region, report)
    if outside:
        sentence = "something outside of the region looks like the board: widen it there if it is."
        suggestion.facts["notes"].append(f"In the sweeps {_listed(outside)} {sentence}")
    return replace(suggestion, facts=suggestion.facts | {"poses": count})


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:10])) + (" ..." if len(numbers) > 10 else "")


def boards_outside(
    source: SweepSource,
    chosen: Sequence[int],
    moved: Sequence[Mask],
    grid: SensorGrid,
    region: Region,
    report: Callable[[], None],
) -> list[int]:
    """Return the sweeps ``chosen`` whose ``moved`` points show a clear board outside of the region, none inside."""
    outside: list[int] = []
    for index, points in zip(chosen, moved, strict=True):
        report()
        sweep = source.sweep(index)
        inside = region.mask(sweep.xyz)
        beside, within = (_boards(sweep, some, grid, sure=True) for some in (points & ~inside, points & inside))
        if beside and not within:
            outside.append(index)
    return outside


def _stand_together(first: Floats | None, second: Floats | None) -> bool:
    """Return whether two boards stand at the same place (2,): then other motion makes no new pose."""
    return first is not None and second is not None and float(np.hypot(*(first - second))) < SAME_PLACE_M


def _is_among(middle: Floats, places: Floats) -> bool:
    """Return whether a place (2,) is near a line between two boards (N, 2), or between a board and the LiDAR."""
    ends = np.concatenate([places, np.zeros((1, 2))])
    along = ends[None] - places[:, None]
    length2 = np.maximum(np.einsum("ijk,ijk->ij", along, along), 1e-9)
    share = np.clip(np.einsum("ijk,ik->ij", along, middle - places) / length2, 0.0, 1.0)
    off = middle - places[:, None] - share[..., None] * along
    return bool(np.hypot(off[..., 0], off[..., 1]).min() < 2.0 * _BESIDE_M)


def _search_everywhere(sweep: Sweep, grid: SensorGrid) -> Floats | None:
    """Return the apex of the likeliest board of a whole sweep, by its own shape alone."""
    pieces = upright_pieces(sweep, np.ones(len(sweep.xyz), np.bool_), grid)[:_MOST_PIECES]
    boards = [board for piece in pieces for board in _boards(sweep, piece, grid, sure=True)]
    best = max(boards, key=lambda board: (board.plane.extent.has_many_rings, board.joint_evidence), default=None)
    return None if best is None else best.xyz


def _boards(sweep: Sweep, chosen: Mask, grid: SensorGrid, *, sure: bool) -> list[BoardEstimate]:
    """Return the boards of either size among the points ``chosen`` (N,); sure: only clear ones."""
    model = BoardModel(grid, sigma=_SIGMA_M, edges=_SIZES_M[0], slack=_SLACK_M)
    boards: list[BoardEstimate] = []
    for window in open_windows(sweep, chosen, grid):
        for plane in (candidate.plane for candidate in find_planes([window], model, _PLANES)):
            if plane.extent.points < _FEWEST_POINTS or plane.extent.width < TRUNK_M:
                continue
            for edges in _SIZES_M:
                board = estimate_board(plane, replace(model, edges=edges), coarse=True)
                if board is not None and board.joint_evidence >= _LEAST_SUPPORT and (not sure or _is_certain(board)):
                    boards.append(board)
    return boards


def _is_certain(board: BoardEstimate) -> bool:
    contradicted = board.agreement.contradicting / (board.plane.extent.points + board.agreement.contradicting)
    return board.is_consistent and board.sigma < _MOST_SIGMA and contradicted < _CONTRADICTED
