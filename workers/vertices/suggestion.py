"""A suggested region: where the board is, from what moves before the static background, or from a board's shape.

What moves in some sweeps is clustered on the ground. In a walk, clusters of a person's size that stay together from
one sweep to the next show where the person walked. In still poses, each pose's likeliest board shows where it stood.
The suggestion is a polygon around that, off the ground, without the posts that stand inside. If the ground shows that
the sensor is tilted or upside down, it is in level axes.
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
from workers.vertices.motion import is_drive
from workers.vertices.pose_detection import SAME_PLACE_M
from workers.vertices.region import Region
from workers.vertices.sensor_grid import SensorGrid, some_grid
from workers.vertices.static_background import StaticBackground
from workers.vertices.still_poses import StillPoses, find_poses
from workers.vertices.suggested_region import (
    ObservedScene,
    Suggestion,
    Thing,
    describe,
    in_level_axes,
    levelled,
    things_of,
    upright_pieces,
)
from workers.vertices.sweep_source import Scattered, SweepSource, any_rings, spread

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FEWEST: Final = 8
_COMPARED: Final = 24  # sweeps of a walk that show the static background
_MOST_POSES, _MOST_EVERYWHERE = 64, 8  # sweeps of poses looked at, and searched whole
_BESIDE_M: Final = 1.2  # a board reaches no farther from its bearer
_TOGETHER_S: Final = 0.5  # sweeps this near in time see a walker in nearly the same place
_FASTEST_M_S: Final = 3.0
_MARGIN_M: Final = 0.5
_STILL_SHARE: Final = 0.4
_AROUND: Final = 0.45  # of the directions: a board, its bearer and others take less
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


def suggest(
    source: SweepSource,
    *,
    samples: int = 360,
    on_sweep: Callable[[int], None] | None = None,
    still: bool = False,
) -> Suggestion:
    """Return the region that the moving person and board walked through, or where the poses' boards stood.

    Args:
        source: the sweeps of a recording whose LiDAR stands still.
        samples: how many sweeps of a walk to look at, spread over the recording.
        on_sweep: called with the number of sweeps read so far; it may raise to stop the work.
        still: the owner says that these are still poses; otherwise the sweeps themselves may show it.

    Raises:
        InputError: ``too_few_sweeps``, ``nothing_moves``, ``everything_moves``, ``no_board_seen``.
    """

    def report(count: int = 0) -> None:
        if on_sweep is not None:
            on_sweep(count)

    source = source if any_rings(source) else Scattered(source)
    grid = some_grid(source)
    if not grid.scattered and is_drive(source, grid, report):
        raise _everything_moves("What stands upright on many sides of the LiDAR shifts together from sweep to sweep")
    poses = find_poses(source, stated=still, on_sweep=report)
    if poses is None and len(source) < _FEWEST:
        raise InputError(
            "too_few_sweeps",
            f"The recording has {len(source)} sweeps; what moves shows in {_FEWEST} at least.",
            "Write the region by hand.",
        )
    chosen = _in_pairs(len(source), samples) if poses is None else spread(len(source), _MOST_POSES)
    background = StaticBackground.of(source, _COMPARED, report) if poses is None else poses.background
    level = grid.R_level_lidar
    scene = ObservedScene(len(chosen))
    boards: list[bool] = []
    moved: list[Mask] = []
    stamps_ns: list[int] = []
    for done, index in enumerate(chosen, start=1):
        sweep = source.sweep(index)
        compared = background.compare(sweep)
        xyz = levelled(sweep.xyz, level)
        apex = None if poses is None else _likeliest(sweep, compared.moved, poses.grid)
        moving = xyz[compared.moved].astype(np.float64)
        things = _bearer(moving, level @ apex) if apex is not None else things_of(moving)
        scene.add(things, xyz, compared.still, compared.moved)
        boards.append(apex is not None)
        if poses is not None:
            moved.append(compared.moved)
        stamps_ns.append(sweep.stamp_ns)
        report(done)
    if len(chosen) > 1 and (scene.still < _STILL_SHARE or scene.around > _AROUND):
        raise _everything_moves(
            f"{scene.still:.0%} of the points stand still, something moves in {scene.around:.0%} of the directions"
        )
    if poses is not None:
        return in_level_axes(_around_poses(source, poses, chosen, scene, boards, moved, level, report), level)
    things = _walker(scene.things, stamps_ns)
    if not any(things):
        raise InputError(
            "nothing_moves",
            "Nothing of a person's size moves in the recording.",
            "Walk through the whole field with the board while recording, or write the region by hand.",
        )
    # Between two sweeps that were looked at the person walked a little farther.
    between_s = (max(stamps_ns) - min(stamps_ns)) * 1e-9 / max(len(chosen) // 2, 1)
    return in_level_axes(describe(things, scene, _MARGIN_M + min(2.0, 0.25 * between_s)), level)


def _everything_moves(observation: str) -> InputError:
    return InputError(
        "everything_moves",
        f"{observation}: the LiDAR itself moves, as in a drive, or each sweep shows another place.",
        "Park the vehicle and record while somebody walks with the board, or holds it still in several places. Or "
        "write the region by hand.",
    )


def _in_pairs(count: int, samples: int) -> list[int]:
    """Return indices of sweeps spread over the recording, in neighbouring pairs, so that things can be met twice."""
    if count <= samples:
        return list(range(count))
    first = np.linspace(0, count - 2, max(samples // 2, _FEWEST)).round().astype(int)
    return sorted({*first.tolist(), *(first + 1).tolist()})


def _walker(things: Sequence[list[Thing]], stamps_ns: Sequence[int]) -> list[list[Thing]]:
    """Return, for each sweep, the moving things of a person's size that a sweep near in time shows, too."""
    met: list[set[int]] = [set() for _ in things]
    alone = [True] * len(things)
    for before, after in pairwise(range(len(things))):
        apart_s = abs(stamps_ns[after] - stamps_ns[before]) * 1e-9
        if apart_s > _TOGETHER_S:
            continue
        alone[before] = alone[after] = False
        for thing in things[before]:
            for other in things[after]:
                if np.hypot(*(thing.middle - other.middle)) <= 0.5 + _FASTEST_M_S * apart_s:
                    met[before].add(id(thing))
                    met[after].add(id(other))
    return [_largest([thing for thing in some if alone[i] or id(thing) in met[i]]) for i, some in enumerate(things)]


def _largest(things: Sequence[Thing]) -> list[Thing]:
    """Return the first thing and what belongs to it, as a board belongs to a person."""
    return [thing for thing in things if np.hypot(*(thing.middle - things[0].middle)) <= _BESIDE_M]


def _around_poses(
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
                scene.things[number] = [t for t in _largest(some) if counts or _is_among(t.middle, places)]
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
    suggestion = describe(scene.things, scene, _MARGIN_M, poses=1, notes=notes)
    region = Region.from_document(in_level_axes(suggestion, level).document)
    first = poses.grouped(source, region, report).first
    places = [some[0].middle if board else None for some, board in zip(scene.things, boards, strict=True)]
    pairs = zip(pairwise(chosen), pairwise(places), strict=True)
    count = 1 + sum(first[a] != first[b] and not _stand_together(*of_boards) for (a, b), of_boards in pairs)
    outside = [] if poses.single else _boards_outside(source, chosen, moved, poses.grid, region, report)
    if outside:
        sentence = "something outside of the region looks like the board: widen it there if it is."
        suggestion.facts["notes"].append(f"In the sweeps {_listed(outside)} {sentence}")
    return replace(suggestion, facts=suggestion.facts | {"poses": count})


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:10])) + (" ..." if len(numbers) > 10 else "")


def _boards_outside(
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


def _bearer(points: Floats, apex: Floats) -> list[Thing]:
    """Return the board and its bearer, among the moving points (N, 3)."""
    points = points[np.linalg.norm(points[:, :2] - apex[:2], axis=1) < _BESIDE_M]
    return [Thing(np.concatenate([points, apex[None]]), apex[:2])]


def _likeliest(sweep: Sweep, chosen: Mask, grid: SensorGrid) -> Floats | None:
    """Return the apex (3,) of the likeliest board among the points ``chosen`` (N,), which hold a board and people."""
    best = max(_boards(sweep, chosen, grid, sure=False), key=lambda board: board.joint_evidence, default=None)
    return None if best is None else best.xyz


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
