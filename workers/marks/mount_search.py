# pyright: reportMissingTypeStubs=false
"""The mount that most seeds agree on: RANSAC over seeds and vertices, and whether chance could do the same."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.geometry.se3 import SE3
from workers.geometry.models import INTRINSICS, ModelName
from workers.geometry.projection import unproject
from workers.geometry.projections.table import PROJECTIONS
from workers.marks.sights import Floats, Lens, MountedLens

# scipy publishes no types.
_binomial_beyond: Callable[[int, int, float], float] = special.bdtrc
INLIER_PX: Final = 15.0
LEAST_PAIRS: Final = 8
LEAST_WITH_LENS: Final = 6
"""Three pairs determine a mount, and the edges of five confirm it: one of six may show nothing."""
LEAST_SHARE: Final = 0.4
RIVAL_SHARE: Final = 0.5
"""Of the best mount's size, from which on a second one is no accident."""
CAMERA_FRAME: Final = "camera"
LIDAR_FRAME: Final = "lidar"
_MOST_SAMPLES: Final = 3072
_LOWER: Final = 0.7  # likelihood of a seed to be the corner, against the one above it
_BATCH: Final = 64
_CONFIDENCE: Final = 1e-3  # of missing every good sample
_SAMPLE: Final = 4  # pairs of SQPnP (Terzakis and Lourakis 2020), one more than it needs
_REFITS: Final = 4
_FARTHEST_M: Final = 18.75  # the longest road train of directive 96/53/EC: camera and LiDAR stand on one vehicle
_FALSE_ALARMS: Final = 1e-3
"""Expected number of mounts of this size by chance (a contrario: Moisan and Stival 2004)."""
_LIMITS_PX: Final = (4.0, 7.5, INLIER_PX)
_LEAST_CHANCE: Final = 1e-3  # three seeds of 15 px in a frame of 1920 x 1080
_NEAREST_DEPTH: Final = 0.05  # of a unit ray: SQPnP takes normalised coordinates


@dataclass(frozen=True, eq=False)
class SeedPairs:
    """M slots: a corner of a sight, and the seeds that may be it.

    Attributes:
        points: (M, 3) metres, LiDAR frame.
        seeds: (M, K, 2) px, not a number where a slot has fewer.
        sight: (M,) index of the sight.
        tip: (M,) whether the corner is the tip: the ends of a frame's width may all be somebody's elbows.
    """

    points: Floats
    seeds: Floats
    sight: NDArray[np.int64]
    tip: NDArray[np.bool_]

    def without(self, explained: NDArray[np.bool_]) -> SeedPairs:
        """The seeds but those (M, K); slots that lose all are left out."""
        seeds = np.where(explained[..., None], np.nan, self.seeds)
        has_seeds = np.isfinite(seeds).any(axis=(1, 2))
        return SeedPairs(self.points[has_seeds], seeds[has_seeds], self.sight[has_seeds], self.tip[has_seeds])


@dataclass(frozen=True, eq=False)
class MountCandidate:
    """A mount and the slots (M,) bool that it explains, each by the seed (M,) nearest to its projection.

    ``support``: slots weighted by agreement (MSAC: Torr and Zisserman 2000).
    """

    camera: MountedLens
    explained: NDArray[np.bool_]
    nearest: NDArray[np.int64]
    support: float

    @property
    def size(self) -> int:
        return int(self.explained.sum())


def search_mounts(
    pairs: SeedPairs, lens: Lens | None, model: ModelName, size: tuple[int, int]
) -> list[MountCandidate]:
    """The best two mounts, the second from the seeds that the first does not explain; the larger first.

    With a lens from samples of four by SQPnP, without one from the model's linear camera. A mount counts if it
    explains `LEAST_PAIRS` slots (of fewer sights, with a lens, `LEAST_WITH_LENS`) in `LEAST_SHARE` of the sights that
    have any, and if chance would not.
    """
    mounts: list[MountCandidate] = []
    few = lens is not None and len(np.unique(pairs.sight)) < LEAST_PAIRS
    left, fewest = pairs, LEAST_WITH_LENS if few else LEAST_PAIRS
    for _ in range(2):
        least = fewest if not mounts else max(fewest, int(RIVAL_SHARE * mounts[0].size))
        best = _best(left, lens, model, size, least)
        if best is None:
            break
        mounts.append(_judged(pairs, best.camera))
        left = left.without(_distances(left, best.camera) < INLIER_PX)
    return sorted(mounts, key=lambda mount: -mount.size)


def _best(
    pairs: SeedPairs, lens: Lens | None, model: ModelName, size: tuple[int, int], least: int
) -> MountCandidate | None:
    random = np.random.Generator(np.random.Philox(key=len(pairs.points)))
    sample = _SAMPLE if lens is not None else PROJECTIONS[model].linear_start.minimal
    if len(pairs.points) < max(least, sample + 1):
        return None
    best: MountCandidate | None = None
    drawn, needed = 0, _samples_for(pairs, least, sample)
    while drawn < needed:
        picks = [_picked(random, pairs, sample) for _ in range(_BATCH)]
        cameras = _by_sqpnp(pairs, picks, lens) if lens is not None else _by_linear(pairs, picks, model, size)
        drawn += _BATCH
        for camera in cameras:
            judged = _judged(pairs, camera)
            if judged.size >= least and (best is None or judged.support > best.support):
                best = _refitted(pairs, judged, lens, model, size)
        if best is not None:
            needed = _samples_for(pairs, best.size, sample)
    return best if best is not None and _holds(pairs, best, sample, drawn, least) else None


def _samples_for(pairs: SeedPairs, agreeing: int, sample: int) -> int:
    """Return how many samples find a mount that explains so many of the slots."""
    share = agreeing / np.isfinite(pairs.seeds[:, :, 0]).sum()
    return min(_MOST_SAMPLES, int(np.log(_CONFIDENCE) / np.log1p(-min(share**sample, 0.5))) + 1)


def _picked(random: np.random.Generator, pairs: SeedPairs, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Slots and a seed of each."""
    tips = np.flatnonzero(pairs.tip)
    among = tips if len(tips) >= count and random.random() < 0.5 else len(pairs.points)
    slots = random.choice(among, count, replace=False)
    # The higher of a frame's seeds are the likelier tips. The least of exponential variates picks by weight.
    rank = np.arange(pairs.seeds.shape[1], dtype=np.float64)
    weight: Floats = _LOWER**rank * np.isfinite(pairs.seeds[slots, :, 0])
    waits: Floats = random.exponential(size=(count, len(rank))) / np.maximum(weight, 1e-9)
    return slots, waits.argmin(axis=1)


def _by_sqpnp(
    pairs: SeedPairs, picks: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]], lens: Lens
) -> list[MountedLens]:
    cameras = (_pose(pairs.points[slots], pairs.seeds[slots, seeds], lens) for slots, seeds in picks)
    return [camera for camera in cameras if camera is not None]


def _pose(points: Floats, pixels: Floats, lens: Lens) -> MountedLens | None:
    rays, _ = unproject(lens.model, lens.intrinsics, pixels)
    ahead = rays[:, 2] > _NEAREST_DEPTH
    if ahead.sum() < _SAMPLE:
        return None
    plane = np.ascontiguousarray(rays[ahead, :2] / rays[ahead, 2:])
    try:
        solved, turn, t = cv2.solvePnP(
            np.ascontiguousarray(points[ahead]), plane, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP
        )
    except cv2.error:  # the points lie in one place
        return None
    if not solved or not np.all(np.isfinite(turn)) or not np.all(np.isfinite(t)):
        return None
    R, t = np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(t, np.float64).ravel()
    if np.linalg.norm(t) > _FARTHEST_M:
        return None
    return MountedLens(lens, SE3(CAMERA_FRAME, LIDAR_FRAME, R, t))


def _by_linear(
    pairs: SeedPairs,
    picks: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]],
    model: ModelName,
    size: tuple[int, int],
) -> list[MountedLens]:
    linear = PROJECTIONS[model].linear_start
    centre = 0.5 * (np.array(size, np.float64) - 1.0)
    slots, seeds = (np.array([pick[k] for pick in picks]) for k in range(2))
    points, marks = pairs.points[slots], pairs.seeds[slots, seeds]
    matrices = linear.fit(points, marks, centre)
    cameras: list[MountedLens] = []
    for P, X, x in zip(matrices, points, marks, strict=True):
        camera = _linear(P, X, x, model, size)
        if camera is not None:
            cameras.append(camera)
    return cameras


def _linear(P: Floats, points: Floats, marks: Floats, model: ModelName, size: tuple[int, int]) -> MountedLens | None:
    """The camera of a linear fit, if a camera of this image could be like it: focal lengths alike, centre inside."""
    centre = 0.5 * (np.array(size, np.float64) - 1.0)
    if not np.all(np.isfinite(P)):
        return None
    read = PROJECTIONS[model].linear_start.read(P, points, marks, centre)
    if read is None or np.linalg.norm(read.t) > _FARTHEST_M:
        return None
    f_x, f_y, c_x, c_y = (read.intrinsics[name] for name in ("f_x", "f_y", "c_x", "c_y"))
    width, height = size
    plausible = 0.2 * width < f_x < 3.0 * width and 0.5 < f_x / max(f_y, 1e-9) < 2.0
    if not plausible or not (0.0 < c_x < width and 0.0 < c_y < height):
        return None
    values = np.array([read.intrinsics.get(name, 0.0) for name in INTRINSICS[model]], np.float64)
    return MountedLens(Lens(model, values), SE3(CAMERA_FRAME, LIDAR_FRAME, read.R, read.t))


def _distances(pairs: SeedPairs, camera: MountedLens) -> Floats:
    """(M, K) px of the seeds from the projections, infinite where there is none of either."""
    distance = np.hypot(*np.moveaxis(pairs.seeds - camera.pixels(pairs.points)[:, None], 2, 0))
    return np.where(np.isfinite(distance), distance, np.inf)


def _judged(pairs: SeedPairs, camera: MountedLens) -> MountCandidate:
    distance = _distances(pairs, camera)
    least = distance.min(axis=1)
    support = float(np.sum(np.clip(1.0 - (least / INLIER_PX) ** 2, 0.0, None)))
    return MountCandidate(camera, least < INLIER_PX, distance.argmin(axis=1), support)


def _refitted(
    pairs: SeedPairs, candidate: MountCandidate, lens: Lens | None, model: ModelName, size: tuple[int, int]
) -> MountCandidate:
    for _ in range(_REFITS):
        slots = np.flatnonzero(candidate.explained)
        points, marks = pairs.points[slots], pairs.seeds[slots, candidate.nearest[slots]]
        if lens is not None:
            camera = _pose(points, marks, lens)
        elif len(slots) >= PROJECTIONS[model].linear_start.minimal:
            centre = 0.5 * (np.array(size, np.float64) - 1.0)
            P = PROJECTIONS[model].linear_start.fit(points[None], marks[None], centre)[0]
            camera = _linear(P, points, marks, model, size)
        else:
            camera = None
        again = None if camera is None else _judged(pairs, camera)
        if again is None or again.support <= candidate.support:
            break
        candidate = again
    return candidate


def _holds(pairs: SeedPairs, candidate: MountCandidate, sample: int, drawn: int, least: int) -> bool:
    """Whether the consensus is large enough, among all slots or the tips alone, and larger than chance makes one."""
    return any(
        _beats_chance(pairs, candidate, family, sample, drawn, least)
        for family in (np.ones_like(pairs.tip), pairs.tip)
    )


def _beats_chance(
    pairs: SeedPairs, candidate: MountCandidate, family: NDArray[np.bool_], sample: int, drawn: int, least: int
) -> bool:
    """A sample explains itself; each other slot is explained by chance as often as seeds of other sights lie near it.

    So seeds that stay in one place, or a mount that sees all vertices in one place, are no evidence.
    """
    explained = candidate.explained & family
    size, sights = int(explained.sum()), len(np.unique(pairs.sight[family]))
    if size < least or len(np.unique(pairs.sight[explained])) < LEAST_SHARE * sights:
        return False
    projected = candidate.camera.pixels(pairs.points[family])
    owner = np.repeat(pairs.sight[family], pairs.seeds.shape[1])
    distance = np.hypot(*np.moveaxis(pairs.seeds[family].reshape(1, -1, 2) - projected[:, None], 2, 0))
    distance = np.where(np.isfinite(distance), distance, np.inf)
    others = owner[None] != pairs.sight[family][:, None]
    own = np.where(others, np.inf, distance).min(axis=1)
    # A sharper consensus of fewer is judged too, as Moulon, Monasse and Marlet 2012 do.
    tails: list[float] = []
    for limit in _LIMITS_PX:
        rarest = _LEAST_CHANCE * (limit / INLIER_PX) ** 2
        by_chance = float(np.sum((distance < limit) & others)) / max(sights - 1, 1) / len(projected)
        agreeing = int(np.sum(own < limit))
        tails.append(_binomial_beyond(agreeing - sample - 1, len(own) - sample, min(max(by_chance, rarest), 1.0)))
    return drawn * len(_LIMITS_PX) * min(tails) < _FALSE_ALARMS
