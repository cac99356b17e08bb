"""A region of interest suggested from what moves against the still background of a recording.

Sweeps spread over the recording tell which places stand still (`occupancy`). What moves before them is clustered on
the ground; clusters of a person's size that stay together from one sweep to the next tell where the person walked.
The suggestion is a polygon around that, off the ground, without the posts that stand inside. If the ground tells that
the sensor is tilted, it is in level axes.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.errors import InputError
from workers.vertices.backdrop import Backdrop
from workers.vertices.occupancy import Occupancy
from workers.vertices.own_motion import passes_by
from workers.vertices.pose_suggestion import suggest_poses
from workers.vertices.sensor_grid import SensorGrid
from workers.vertices.still_poses import find_poses
from workers.vertices.suggested_region import (
    KEPT,
    ObservedScene,
    Suggestion,
    Thing,
    describe,
    in_level_axes,
    levelled,
    things_of,
)
from workers.vertices.sweep_source import SweepSource
from workers.vertices.upside_down import Turned, hangs, some_grid, turned_back

Floats = NDArray[np.float64]

_FEWEST: Final = 8
_COMPARED: Final = 24  # sweeps that tell whether the LiDAR moves
_BESIDE_M: Final = 1.2
_TOGETHER_S: Final = 0.5  # sweeps this near in time see a walker in nearly the same place
_FASTEST_M_S: Final = 3.0
_MARGIN_M: Final = 0.5


def suggest(
    source: SweepSource,
    *,
    samples: int = 360,
    on_sweep: Callable[[int], None] | None = None,
    still: bool = False,
) -> Suggestion:
    """The region that the moving person and board walked through, or the poses' boards.

    Args:
        source: the sweeps of a recording whose LiDAR stands still.
        samples: how many sweeps to look at, spread over the recording.
        on_sweep: called with the number of sweeps read so far; it may raise to stop the work.
        still: the owner says that these are still poses; it is noticed otherwise, too.

    Raises:
        InputError: ``too_few_sweeps``, ``nothing_moves``, ``everything_moves``, ``no_board_seen``.
    """
    grid = some_grid(source)
    if hangs(grid):
        turned = Turned(source, grid)
        return turned_back(_suggest(turned, some_grid(turned), samples, on_sweep, still))
    return _suggest(source, grid, samples, on_sweep, still)


def _suggest(
    source: SweepSource, grid: SensorGrid, samples: int, on_sweep: Callable[[int], None] | None, still: bool
) -> Suggestion:
    def check() -> None:
        if on_sweep is not None:
            on_sweep(0)

    if Backdrop.of(source, _COMPARED, check).moves_itself():
        raise _everything_moves("What stands upright around the LiDAR is elsewhere in each sweep")
    if passes_by(source, grid, check):
        raise _everything_moves("What stands upright on many sides of the LiDAR shifts together from sweep to sweep")
    level = grid.R_level_lidar
    poses = find_poses(source, stated=still, on_sweep=check)
    if poses is not None:
        return suggest_poses(source, poses, level, check)
    if len(source) < _FEWEST:
        raise InputError(
            "too_few_sweeps",
            f"The recording has {len(source)} sweeps; what moves shows in {_FEWEST} at least.",
            "Write the region by hand.",
        )
    chosen = _spread(len(source), samples)
    occupancy = Occupancy()
    stamps_ns: list[int] = []
    for done, index in enumerate(chosen, start=1):
        sweep = source.sweep(index)
        occupancy.add(sweep)
        stamps_ns.append(sweep.stamp_ns)
        if on_sweep is not None:
            on_sweep(done)
    scene = _look(source, chosen, occupancy, level, on_sweep)
    if scene.still < 0.4 * scene.points:
        raise _everything_moves(f"Only {scene.still / max(scene.points, 1):.0%} of the points stand still")
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


def _look(
    source: SweepSource,
    chosen: list[int],
    occupancy: Occupancy,
    level: Floats,
    on_sweep: Callable[[int], None] | None,
) -> ObservedScene:
    """Read the sweeps again, now that it is known what stands still; all of them at once may not fit in memory.

    Points are kept in level axes.
    """
    scene = ObservedScene()
    for number, index in enumerate(chosen):
        sweep = source.sweep(index)
        moving, still = occupancy.moving(sweep)
        scene.points += len(sweep.xyz)
        scene.still += int(np.count_nonzero(still))
        xyz = levelled(sweep.xyz, level)
        scene.things.append(things_of(xyz[moving].astype(np.float64)))
        if number % max(1, len(chosen) // KEPT) == 0:
            scene.clouds[number] = xyz
            scene.background.append(xyz[still].astype(np.float64))
        if on_sweep is not None:
            on_sweep(len(chosen))
    return scene


def _spread(count: int, samples: int) -> list[int]:
    """Numbers of sweeps spread over the recording, in neighbouring pairs, so that things can be met twice."""
    if count <= samples:
        return list(range(count))
    first = np.linspace(0, count - 2, max(samples // 2, _FEWEST)).round().astype(int)
    return sorted({*first.tolist(), *(first + 1).tolist()})


def _walker(things: list[list[Thing]], stamps_ns: list[int]) -> list[list[Thing]]:
    """For each sweep what moves and has a person's size; with a neighbour near in time, only what is there too."""
    met: list[dict[int, Thing]] = [{} for _ in things]
    alone = [True] * len(things)
    for before, after in pairwise(range(len(things))):
        apart_s = abs(stamps_ns[after] - stamps_ns[before]) * 1e-9
        if apart_s > _TOGETHER_S:
            continue
        alone[before] = alone[after] = False
        for thing in things[before]:
            for other in things[after]:
                if np.hypot(*(thing.middle - other.middle)) <= 0.5 + _FASTEST_M_S * apart_s:
                    met[before][id(thing)] = thing
                    met[after][id(other)] = other
    return [_largest(things[i] if alone[i] else list(met[i].values())) for i in range(len(things))]


def _largest(things: list[Thing]) -> list[Thing]:
    """The thing with the largest face, and what belongs to it: a board adds to a person's."""
    if not things:
        return []
    # As many points as a face has, seen from one metre.
    largest = max(things, key=lambda thing: len(thing.points) * float(thing.middle @ thing.middle))
    return [thing for thing in things if np.hypot(*(thing.middle - largest.middle)) <= _BESIDE_M]
