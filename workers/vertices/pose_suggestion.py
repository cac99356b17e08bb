"""A region suggested from still poses: around what differs from pose to pose, or around a board's shape."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.errors import InputError
from workers.readers.recording import Sweep
from workers.vertices.board_search import search, search_everywhere
from workers.vertices.region import Region
from workers.vertices.still_poses import StillPoses
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

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_MOST: Final = 64  # sweeps that are looked at
_BESIDE_M: Final = 1.2  # a board reaches no farther from its bearer
_MARGIN_M: Final = 0.5
_MOST_EVERYWHERE: Final = 8


def suggest_poses(source: SweepSource, poses: StillPoses, level: Floats, on_sweep: Callable[[], None]) -> Suggestion:
    """The region of a recording of still poses, in level axes; on_sweep may raise to stop the work.

    Args:
        level: R_level_lidar (3, 3).

    Raises:
        InputError: ``no_board_seen``.
    """
    chosen = sorted({int(n) for n in np.linspace(0, len(source) - 1, min(_MOST, len(source))).round()})
    scene = ObservedScene()
    for number, index in enumerate(chosen):
        sweep = source.sweep(index)
        on_sweep()
        compared = poses.backdrop.compare(sweep)
        scene.things.append(_bearer(sweep, compared.moved, poses, level))
        _keep(scene, number, levelled(sweep.xyz, level), compared.still, len(chosen))
    by_shape = not any(scene.things)
    if by_shape:
        _search_shapes(source, chosen, poses, scene, level, on_sweep)
    if not any(scene.things):
        raise InputError(
            "no_board_seen",
            "Nothing differs from sweep to sweep, and nothing looks like a board that stands on its tip.",
            "Move the board from pose to pose, hold it on its tip within 15 m, and upload with --still. Or write the "
            "region by hand.",
        )
    suggestion = in_level_axes(
        describe(scene.things, scene, _MARGIN_M, poses=1, notes=_notes(poses, by_shape)), level
    )
    grouped = poses.grouped(source, Region.from_document(suggestion.document), on_sweep)
    suggestion.facts["poses"] = grouped.count
    return suggestion


def _notes(poses: StillPoses, by_shape: bool) -> list[str]:
    notes: list[str] = []
    if by_shape:
        notes.append(
            "The board was found by its shape alone, because no other pose shows what stands there without it."
        )
    if poses.walked:
        notes.append(
            "The recording was uploaded as still poses, but somebody walks in it. If it is a walk, upload it without "
            "--still. Then apexcal uses the track and the times of the points."
        )
    return notes


def _bearer(sweep: Sweep, moved: Mask, poses: StillPoses, level: Floats) -> list[Thing]:
    """The board and who holds it, if the board is found; else all that moved and has a person's size."""
    if not moved.any():
        return []
    board = search(sweep, moved, poses.grid, sure=False)
    points = levelled(sweep.xyz[moved], level).astype(np.float64)
    return _around(points, level @ board.apex) if board else things_of(points)


def _around(points: Floats, apex: Floats) -> list[Thing]:
    points = points[np.linalg.norm(points[:, :2] - apex[:2], axis=1) < _BESIDE_M]
    return [Thing(np.concatenate([points, apex[None]]), apex[:2])]


def _search_shapes(
    source: SweepSource,
    chosen: list[int],
    poses: StillPoses,
    scene: ObservedScene,
    level: Floats,
    on_sweep: Callable[[], None],
) -> None:
    for number in sorted({int(n) for n in np.linspace(0, len(chosen) - 1, min(_MOST_EVERYWHERE, len(chosen)))}):
        sweep = source.sweep(chosen[number])
        on_sweep()
        board = search_everywhere(sweep, poses.grid)
        if board is not None:
            corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.6, 0.0)])
            apex = level @ board.apex
            scene.things[number] = [Thing(apex + _BESIDE_M * corners / 2.0, apex[:2])]


def _keep(scene: ObservedScene, number: int, xyz: NDArray[np.float32], still: Mask, count: int) -> None:
    scene.points += len(xyz)
    scene.still += int(np.count_nonzero(still))
    if number % max(1, count // KEPT) == 0:
        scene.clouds[number] = xyz
        scene.background.append(xyz[still].astype(np.float64))
