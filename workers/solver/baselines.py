"""Baselines beside the search: least squares from the centre of the bounds, and from a linear start."""

from math import log
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.geometry.rotations import euler_from_rotation, vector_from_rotation
from workers.geometry.linear_cameras import LinearCamera
from workers.geometry.models import INTRINSICS
from workers.geometry.projections.table import PROJECTIONS
from workers.solver.polish import Fit, cost_of, polish
from workers.solver.problem import FitProblem
from workers.solver.random_streams import stream_key

Floats = NDArray[np.float64]
_BATCH: Final = 64
_AT_ONCE: Final = 2**20
"""Numbers of one array: a batch of 100,000 pairs would take gigabytes, and seconds without a look at `stop`."""
_MOST_SAMPLES: Final = 4096
_CONFIDENCE: Final = 0.9999
_REFITS: Final = 4
_FINALISTS: Final = 3


def baseline(problem: FitProblem) -> Fit:
    """Least squares from the centre of the bounds, with no search before it."""
    return polish(problem, 0.5 * (problem.lower + problem.upper))


def linear_baseline(problem: FitProblem) -> Fit | None:
    """Least squares from a linear camera fitted to the pairs that RANSAC kept; None where no camera fits them.

    The model's linear camera (`Projection.linear_start`) inside RANSAC (Fischler and Bolles 1981). Reproducible: the
    samples follow from the problem's seed.
    """
    starts = linear_starts(problem)
    fits = [polish(problem, start) for start in starts]
    if not fits:
        return None
    # Robust scales differ from fit to fit; they are compared at one of them.
    scale = min((fit.scale_px for fit in fits if fit.scale_px is not None), default=None)
    return min(fits, key=lambda fit: cost_of(problem, fit.parameters, scale))


def linear_starts(problem: FitProblem) -> list[Floats]:
    """Parameter vectors (D,) of the best linear cameras, the one with the most inliers first; may be empty."""
    used = np.flatnonzero(problem.weights > 0.0)
    points, marks = problem.points[used], problem.pixels[used]
    linear = PROJECTIONS[problem.model].linear_start
    if len(used) < linear.minimal:
        return []
    centre = 0.5 * (problem.lower + problem.upper)[8:10]
    threshold = linear.inlier_share * problem.diagonal_px
    starts: list[Floats] = []
    for inliers in _consensus(problem, points, marks, centre, threshold):
        camera = linear.camera(points[inliers], marks[inliers], centre)
        if camera is not None:
            starts.append(_parameters(problem, camera))
    return starts


def _consensus(
    problem: FitProblem, points: Floats, marks: Floats, centre: Floats, threshold: float
) -> list[NDArray[np.bool_]]:
    """RANSAC: masks (N,) of the pairs that the best few linear cameras explain, refitted to their inliers."""
    rng = np.random.Generator(np.random.Philox(key=int(stream_key(problem, -1, 0))))
    n, size = len(points), PROJECTIONS[problem.model].linear_start.minimal
    best: list[tuple[int, NDArray[np.bool_]]] = []
    drawn, needed = 0, _MOST_SAMPLES
    while drawn < needed:
        masks = _sampled(problem, rng, points, marks, centre, threshold)
        drawn += _BATCH
        for index in np.argsort(-masks.sum(axis=1), kind="stable")[:_FINALISTS]:
            mask = _refitted(problem, points, marks, centre, threshold, masks[index])
            best.append((int(mask.sum()), mask))
        best = sorted(best, key=lambda candidate: -candidate[0])[:_FINALISTS]
        share = best[0][0] / n
        failing = min(max(1.0 - share**size, 1e-12), 1.0 - 1e-12)
        needed = min(_MOST_SAMPLES, int(log(1.0 - _CONFIDENCE) / log(failing)) + 1)
    # Cameras that the same pairs fit are one.
    return list({mask.tobytes(): mask for count, mask in best if count > size}.values())


def _sampled(
    problem: FitProblem,
    rng: np.random.Generator,
    points: Floats,
    marks: Floats,
    centre: Floats,
    threshold: float,
) -> NDArray[np.bool_]:
    """Masks (_BATCH, N) of the pairs that linear cameras of random samples explain."""
    linear = PROJECTIONS[problem.model].linear_start
    masks = np.empty((_BATCH, len(points)), dtype=np.bool_)
    rows = max(1, _AT_ONCE // len(points))
    for first in range(0, _BATCH, rows):
        problem.stop.check()
        part = masks[first : first + rows]
        picks = np.argsort(rng.random(part.shape), axis=1)[:, : linear.minimal]
        cameras = linear.fit(points[picks], marks[picks], centre)
        np.less(linear.distances(cameras, points, marks, centre), threshold, out=part)
    return masks


def _refitted(
    problem: FitProblem, points: Floats, marks: Floats, centre: Floats, threshold: float, mask: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    linear = PROJECTIONS[problem.model].linear_start
    for _ in range(_REFITS):
        problem.stop.check()
        if mask.sum() < linear.minimal:
            break
        camera = linear.fit(points[mask][None], marks[mask][None], centre)
        again = linear.distances(camera, points, marks, centre)[0] < threshold
        if again.sum() <= mask.sum():
            break
        mask = again
    return mask


def _parameters(problem: FitProblem, camera: LinearCamera) -> Floats:
    # The linear camera's parts in the search's parameters; the distortion it does not know starts at zero.
    p = np.zeros(len(problem.names))
    if problem.search == "euler":
        p[:3] = euler_from_rotation(camera.R)
    else:
        p[:3] = vector_from_rotation(camera.R @ problem.nominal.R.T)
    p[3:6] = camera.t
    p[6:] = [camera.intrinsics.get(name, 0.0) for name in INTRINSICS[problem.model]]
    return np.clip(p, problem.lower, problem.upper)
