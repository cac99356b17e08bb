"""A suggested region: where the board is, from what moves before the static background, or from a board's shape.

What moves in some sweeps is clustered on the ground. In a walk, clusters of a person's size that stay together from
one sweep to the next show where the person walked. In still poses, each pose's likeliest board shows where it stood.
The suggestion is a polygon around that, off the ground, without the posts that stand inside. If the ground shows that
the sensor is tilted or upside down, it is in level axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.errors import InputError
from workers.vertices.motion import is_drive
from workers.vertices.pose_suggestion import MARGIN_M, around_poses, bearer_of, largest, likeliest_board
from workers.vertices.sensor_grid import some_grid
from workers.vertices.static_background import StaticBackground
from workers.vertices.still_poses import find_poses
from workers.vertices.suggested_region import (
    ObservedScene,
    Suggestion,
    Thing,
    describe,
    in_level_axes,
    levelled,
    things_of,
)
from workers.vertices.sweep_source import Scattered, SweepSource, any_rings, spread

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FEWEST: Final = 8
_COMPARED: Final = 24  # sweeps of a walk that show the static background
_MOST_POSES: Final = 64  # sweeps of poses looked at
_TOGETHER_S: Final = 0.5  # sweeps this near in time see a walker in nearly the same place
_FASTEST_M_S: Final = 3.0
_STILL_SHARE: Final = 0.4
_AROUND: Final = 0.45  # of the directions: a board, its bearer and others take less


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
        apex = None if poses is None else likeliest_board(sweep, compared.moved, poses.grid)
        moving = xyz[compared.moved].astype(np.float64)
        things = bearer_of(moving, level @ apex) if apex is not None else things_of(moving)
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
        return in_level_axes(around_poses(source, poses, chosen, scene, boards, moved, level, report), level)
    things = _walker(scene.things, stamps_ns)
    if not any(things):
        raise InputError(
            "nothing_moves",
            "Nothing of a person's size moves in the recording.",
            "Walk through the whole field with the board while recording, or write the region by hand.",
        )
    # Between two sweeps that were looked at the person walked a little farther.
    between_s = (max(stamps_ns) - min(stamps_ns)) * 1e-9 / max(len(chosen) // 2, 1)
    return in_level_axes(describe(things, scene, MARGIN_M + min(2.0, 0.25 * between_s)), level)


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
    return [largest([thing for thing in some if alone[i] or id(thing) in met[i]]) for i, some in enumerate(things)]
