"""The clock and the mount together: seeds are paired with corners at several offsets, where the board moves.

The offset at which most seeds agree on a mount is refined by `workers.marks.clock`, and again by the marks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from workers.marks.clock import COARSE_S, ClockShift, fit_clock, is_walk
from workers.marks.edges import CornerFit
from workers.marks.measuring import MarkTask, Measured
from workers.marks.mount_search import INLIER_PX, LEAST_PAIRS, MountCandidate, SeedPairs, search_mounts
from workers.marks.seeds import MOST_SEEDS, FrameSeeds
from workers.marks.sights import Floats, MountedLens

_MARKED_PX: Final = 0.25 * INLIER_PX  # marks farther than this from a vertex count no more for the clock


def at_best_clock(
    task: MarkTask, seeds: dict[int, FrameSeeds]
) -> tuple[MarkTask, SeedPairs, Sequence[MountCandidate]]:
    """The task at the clock at which most seeds agree, its pairs and their mounts. A board that stands tells none."""
    best: tuple[MarkTask, SeedPairs, Sequence[MountCandidate]] | None = None
    for offset_s in COARSE_S if is_walk(task.sights) else (0.0,):
        at = task.at(offset_s)
        pairs = seed_pairs(at, seeds)
        candidates = search_mounts(pairs, task.lens, task.model, task.size)
        if best is None or (candidates and (not best[2] or candidates[0].size > best[2][0].size)):
            best = at, pairs, candidates
    assert best is not None
    if not best[2] or not is_walk(task.sights):
        return best
    at, pairs, (candidate, *_) = best
    slots = np.flatnonzero(candidate.explained)
    sights: list[int] = pairs.sight[slots].tolist()
    velocities = np.array([task.sights[index].velocity for index in sights], np.float64)
    sighted = pairs.seeds[slots, candidate.nearest[slots]]
    shift = fit_clock(
        candidate.camera, task.lens, pairs.points[slots], velocities, sighted, task.size, 0.5 * INLIER_PX
    )
    if shift is None:
        return best
    total = ClockShift(at.offset_s + shift.offset_s, shift.sigma_s)
    finer = task.at(total.offset_s if total.is_sure else 0.0)
    if finer.offset_s == at.offset_s:
        return best
    pairs = seed_pairs(finer, seeds)
    return finer, pairs, search_mounts(pairs, task.lens, task.model, task.size)


def at_marked_clock(task: MarkTask, measured: dict[int, Measured], camera: MountedLens) -> MarkTask:
    """The task at the clock that its marks tell; the same where they tell none, or a board stands."""
    tips = {index: fit for index, corners in measured.items() if isinstance(fit := corners.get("top"), CornerFit)}
    if not is_walk(task.sights) or len(tips) < LEAST_PAIRS:
        return task
    sights = [task.sights[index] for index in tips]
    shift = fit_clock(
        camera, task.lens, np.array([sight.corners["top"] for sight in sights]),
        np.array([sight.velocity for sight in sights]), np.array([fit.pixel for fit in tips.values()]), task.size,
        _MARKED_PX,
    )  # fmt: skip
    if shift is None:
        return task
    total = ClockShift(task.offset_s + shift.offset_s, shift.sigma_s)
    return task.at(total.offset_s if total.is_sure else 0.0)


def seed_pairs(task: MarkTask, seeds: dict[int, FrameSeeds]) -> SeedPairs:
    """The corners of all sights beside the seeds of their frames."""
    points: list[Floats] = []
    places: list[Floats] = []
    owner: list[int] = []
    tip: list[bool] = []
    for index, sight in enumerate(task.sights):
        for name, of_corner in seeds[sight.frame].pixels.items() if sight.frame in seeds else ():
            if name not in sight.corners:
                continue
            row = np.full((MOST_SEEDS, 2), np.nan)
            row[: len(of_corner)] = of_corner
            points.append(sight.corners[name])
            places.append(row)
            owner.append(index)
            tip.append(name == "top")
    return SeedPairs(
        np.array(points, np.float64).reshape(-1, 3),
        np.array(places, np.float64).reshape(-1, MOST_SEEDS, 2),
        np.array(owner, np.int64),
        np.array(tip, np.bool_),
    )
