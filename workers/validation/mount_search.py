"""Search the turn and shift of a mount under which depth edges lie on image edges, from coarse to fine.

The score is the mean image gradient across the edges over the gradients nearby, as in :mod:`edge_check`. A coarse
grid of turns on small images gives starts. From each start the search follows the summit of a quadratic through the
scores around it, on larger and larger images. Deviations come from the jackknife over regions of the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from apexcal.geometry.rotations import rotation_from_vector, vector_from_rotation
from workers.geometry.projection import project
from workers.validation.calibration import KnownCalibration
from workers.validation.edge_frames import UNIT, EdgeFrame
from workers.validation.offsets import MOST_GROUPS, group_mean, jackknife, look_up

Floats = NDArray[np.float64]

TURN: Final = (0, 1, 2)
SHIFT: Final = (3, 4, 5)
ALL: Final = (*TURN, *SHIFT)
REACH_DEG: Final = 10.0
REACH_M: Final = 0.3
# Steps of the coarse grid: a roll moves a pixel 25 degrees off the axis by half as much.
_STEP_DEG: Final = 1.0
_ROLL_STEP_DEG: Final = 2.0
# Pixels of the images of each stage, and the reach of its scores around a mount: turns and roll in degrees, shifts
# across and along the axis in metres. A shift of 5 cm moves an object 8 m away by 0.35 degrees.
_COARSE_DEG: Final = 0.5
_STAGES: Final = ((0.25, 1.0), (0.12, 0.6), (0.0, 0.35))
_AROUND: Final = np.array([np.radians(1.0), np.radians(1.0), np.radians(2.0), 0.14, 0.14, 0.4])
_ROUNDS: Final = 5
_COARSE_EDGES: Final = 1500
_MIDDLE_EDGES: Final = 8000
# Number of starts, and their least distance from each other: degrees by which the mean edge moves.
_STARTS: Final = 6
APART_DEG: Final = 1.0
# A direction stays open if the score bends less in it than this share of the sharpest bend.
_FLAT: Final = 0.01


class Summit(NamedTuple):
    """A mount near which the score is highest.

    Attributes:
        mount: the calibration with it.
        offset: (6,) from the deployed mount: turns about the camera's axes, rad, then shifts along them, m.
        covariance: (6, 6) of the jackknife; zero for parameters that were not free, the squared reach for open ones.
        scores: (G,) sums and counts (G,) at this mount, by group.
        is_summit: the search ended inside its reach.
    """

    mount: KnownCalibration
    offset: Floats
    covariance: Floats
    sums: Floats
    counts: Floats
    is_summit: bool

    @property
    def score(self) -> float:
        """Return the mean score of all groups."""
        return float(self.sums.sum() / max(self.counts.sum(), 1.0))

    @property
    def excess(self) -> Floats:
        """Return (G,) gradients in excess of those nearby. With few edges in the image a mean is high by chance."""
        return self.sums - self.counts

    def lead_over(self, other: Summit) -> float:
        """Return by how many deviations of the difference the mean excess is above that of another mount."""
        edges = np.maximum(self.counts, other.counts)
        there = edges > 0
        if np.count_nonzero(there) < 3:
            return 0.0
        difference, edges = (self.excess - other.excess)[there], edges[there]
        sigma = float(jackknife(_without_each(difference[None], edges[None]).T)[0])
        return float(difference.sum() / edges.sum()) / max(sigma, 1e-9)


class MountSearch:
    """The search for the mount with the highest score, on the frames of one camera."""

    def __init__(self, calibration: KnownCalibration, frames: Sequence[EdgeFrame]) -> None:
        self._calibration, self._frames = calibration, frames
        focal_px = float(calibration.intrinsics[0])
        self._focal_px = focal_px
        sizes = [np.radians(degrees) for degrees, _ in _STAGES]
        self._stages = [[frame.made_smaller(size, focal_px) if size else frame for frame in frames] for size in sizes]
        self._edges = sum(len(frame.points) for frame in frames)

    def starts(self) -> list[KnownCalibration]:
        """Return the best turns of the coarse grid, each APART_DEG from the others, the deployed mount first."""
        every = max(self._edges // _COARSE_EDGES, 1)
        small = [frame.made_smaller(np.radians(_COARSE_DEG), self._focal_px) for frame in self._frames]
        points, beyond, weight = (
            np.concatenate([getattr(frame, name)[::every] for frame in small])
            for name in ("points", "beyond", "weight")
        )
        of_frame = np.repeat(np.arange(len(small)), [len(frame.points[::every]) for frame in small])
        maps, scale = np.stack([frame.maps for frame in small]), small[0].scale
        steps = np.arange(-REACH_DEG, REACH_DEG + 0.1, _STEP_DEG)
        rolls = np.arange(-REACH_DEG, REACH_DEG + 0.1, _ROLL_STEP_DEG)
        turns = np.stack(np.meshgrid(steps, steps, rolls, indexing="ij"), axis=-1).reshape(-1, 3)
        across = weight[:, None] * _across(self._calibration, points, beyond)
        in_camera = self._calibration.mount.apply(points)
        sums, counts = np.zeros(len(turns)), np.zeros(len(turns))
        for number, turn in enumerate(turns):
            R = rotation_from_vector(np.radians(turn))
            pixels, violation = project(self._calibration.model, self._calibration.intrinsics, in_camera @ R.T)
            is_visible = self._calibration.shows(pixels, violation)
            sums[number], counts[number] = _looked_up(maps, scale, pixels, is_visible, across, of_frame)
        # Few edges in the image have a high mean by chance.
        excess = (sums - UNIT * counts) / np.maximum(counts, 0.5 * counts.max() + 1.0)
        chosen = [np.zeros(3)]
        for index in np.argsort(-excess):
            apart = np.abs(np.array(chosen) - turns[index]) / [1.5 * _STEP_DEG, 1.5 * _STEP_DEG, 1.5 * _ROLL_STEP_DEG]
            if apart.max(axis=1).min() > 1.0:
                chosen.append(turns[index])
            if len(chosen) == _STARTS:
                break
        return [self._calibration.moved(turn, np.zeros(3)) for turn in chosen]

    def summit(self, start: KnownCalibration, free: Sequence[int], first_stage: int = 0) -> Summit:
        """Return the summit that the search reaches from a mount by moving the parameters ``free`` of ALL."""
        mount, is_summit = start, True
        for stage in range(first_stage, len(_STAGES)):
            window = _AROUND * _STAGES[stage][1]
            every = 1 if stage == len(_STAGES) - 1 else max(self._edges // _MIDDLE_EDGES, 1)
            for _ in range(_ROUNDS):
                sums, counts, samples = self._around(mount, free, window, stage, every)
                step = _summits(samples, group_mean(sums, counts)[:, None])[:, 0]
                moved = np.zeros(6)
                moved[list(free)] = step * window[list(free)]
                mount = mount.moved(np.degrees(moved[:3]), moved[3:])
                is_summit = bool(np.linalg.norm(step) < 0.9)
                if np.linalg.norm(step) < 0.15:
                    break
        stage = len(_STAGES) - 1
        sums, counts, samples = self._around(mount, free, _AROUND * _STAGES[stage][1], stage, 1)
        return self._finished(mount, free, sums, counts, samples, is_summit=is_summit)

    def _around(
        self, mount: KnownCalibration, free: Sequence[int], window: Floats, stage: int, every: int
    ) -> tuple[Floats, Floats, Floats]:
        """Return sums and counts (K, G) around a mount, and the samples (K, F) in units of the window.

        The first sample is the mount itself.
        """
        samples = _samples(len(free))
        offsets = np.zeros((len(samples), 6))
        offsets[:, list(free)] = samples * window[list(free)]
        sums, counts = np.zeros((len(samples), MOST_GROUPS)), np.zeros((len(samples), MOST_GROUPS))
        for frame in self._stages[stage]:
            parts = frame.parts(mount, every)
            if len(parts.pixels):
                look_up(frame.maps, frame.scale, *parts, offsets, sums, counts)
        return sums / UNIT, counts, samples

    def _finished(
        self, mount: KnownCalibration, free: Sequence[int], sums: Floats, counts: Floats, samples: Floats, *,
        is_summit: bool,
    ) -> Summit:  # fmt: skip
        window = (_AROUND * _STAGES[-1][1])[list(free)]
        there = counts[0] > 0
        without = _without_each(sums[:, there], counts[:, there])
        summits, flat = _summits(samples, without), _flat(samples, group_mean(sums, counts))
        groups = int(np.count_nonzero(there))
        spread = (summits - summits.mean(axis=1, keepdims=True)) * window[:, None]
        covariance = np.zeros((6, 6))
        reach = np.array([*np.radians([REACH_DEG] * 3), *[REACH_M] * 3])[list(free)]
        along = flat * reach[:, None]
        covariance[np.ix_(list(free), list(free))] = (groups - 1) / max(
            groups, 1
        ) * spread @ spread.T + along @ along.T
        offset = self.offset(mount)
        inside = bool((np.abs(offset) <= [*np.radians([REACH_DEG] * 3), *[1.5 * REACH_M] * 3]).all())
        return Summit(mount, offset, covariance, sums[0], counts[0], is_summit and inside)

    def offset(self, mount: KnownCalibration) -> Floats:
        """Return (6,) turns, rad, and shifts, m, that lead from the deployed mount to another."""
        R, t = mount.mount.R @ self._calibration.mount.R.T, mount.mount.t
        return np.concatenate([vector_from_rotation(R), t - R @ self._calibration.mount.t])

    def apart_deg(self, first: KnownCalibration, second: KnownCalibration) -> float:
        """Return the angle, degrees, between the typical edge's directions from the camera under two mounts."""
        points = np.concatenate([frame.points[::10] for frame in self._frames])
        if not len(points):
            return 0.0
        (p, q) = (mount.mount.apply(points) for mount in (first, second))
        sine = np.linalg.norm(np.cross(p, q), axis=1) / (np.linalg.norm(p, axis=1) * np.linalg.norm(q, axis=1))
        return float(np.degrees(np.median(np.arcsin(np.clip(sine, 0.0, 1.0)))))


def _across(calibration: KnownCalibration, points: Floats, beyond: Floats) -> Floats:
    """Return (N, 2) the shares of each edge's gradient along u and v; zero if its direction is unknown."""
    with np.errstate(invalid="ignore"):
        across = np.abs(np.nan_to_num(calibration.project(beyond)[0] - calibration.project(points)[0]))
    return across / np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]


@njit(nogil=True, error_model="numpy", cache=True)
def _looked_up(
    maps: NDArray[np.uint8],
    scale: float,
    pixels: Floats,
    is_visible: NDArray[np.bool_],
    across: Floats,
    of_frame: NDArray[np.int64],
) -> tuple[float, float]:
    """Return sum and weight of the edges' visible pixels (N, 2) in maps (frames, 2, h, w), weighted by `across`."""
    _, _, height, width = maps.shape
    whole, count = 0.0, 0.0
    for i in range(len(pixels)):
        if is_visible[i]:
            column = min(int((pixels[i, 0] + 0.5) * scale), width - 1)
            row = min(int((pixels[i, 1] + 0.5) * scale), height - 1)
            for c in range(2):
                whole += across[i, c] * maps[of_frame[i], c, row, column]
            count += np.hypot(across[i, 0], across[i, 1])
    return whole, count


def _without_each(sums: Floats, counts: Floats) -> Floats:
    """Return (K, G) means, each without one group, of sums and counts (K, G)."""
    left = sums.sum(axis=1, keepdims=True) - sums
    return left / np.maximum(counts.sum(axis=1, keepdims=True) - counts, 1.0)


def _samples(count: int) -> Floats:
    """Return (K, F) points in the unit ball, the middle first, and their mirror images."""
    half = 12 * (count + 1) * (count + 2) // 4
    random = np.random.default_rng(count)
    direction = random.normal(size=(half, count))
    direction *= (random.uniform(size=half) ** (1.0 / count) / np.linalg.norm(direction, axis=1))[:, None]
    return np.concatenate([np.zeros((1, count)), direction, -direction])


def _quadratic(samples: Floats, scores: Floats) -> tuple[Floats, Floats]:
    """Return gradients (F, M) and Hessians (M, F, F) at the middle of quadratics through scores (K, M)."""
    count = samples.shape[1]
    first, second = np.triu_indices(count)
    design = np.column_stack([np.ones(len(samples)), samples, samples[:, first] * samples[:, second]])
    coefficients = np.asarray(np.linalg.lstsq(design, scores, rcond=None)[0], np.float64)
    H = np.zeros((scores.shape[1], count, count))
    H[:, first, second] = coefficients[1 + count :].T
    return coefficients[1 : 1 + count], H + H.transpose(0, 2, 1)


def _summits(samples: Floats, scores: Floats) -> Floats:
    """Return (F, M) summits of quadratics through scores (K, M), at most a window away, open directions left out."""
    gradient, H = _quadratic(samples, scores)
    values, vectors = np.linalg.eigh(-H)
    sharpest = np.maximum(values.max(axis=1, keepdims=True), 1e-12)
    # Where the score bends up, the step goes uphill as far as the window.
    bend = np.where(values < -_FLAT * sharpest, np.abs(values), np.maximum(values, _FLAT * sharpest))
    along = np.einsum("mfe,fm->me", vectors, gradient) / bend
    along[(np.abs(values) <= _FLAT * sharpest)] = 0.0
    step = np.einsum("mfe,me->fm", vectors, along)
    return step / np.maximum(np.linalg.norm(step, axis=0), 1.0)


def _flat(samples: Floats, score: Floats) -> Floats:
    """Return (F, D) unit directions in which the score does not bend down."""
    values, vectors = np.linalg.eigh(-_quadratic(samples, score[:, None])[1][0])
    return vectors[:, values <= _FLAT * max(values.max(), 1e-12)]
