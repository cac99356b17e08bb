"""The plain ways beside the search: least squares from the centre of the bounds, and from a linear start."""

from math import log
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.geometry.rotations import euler_from_rotation, vector_from_rotation
from workers.solver.linear_start import MINIMAL, Camera, camera_of, fit_linear, linear_distances
from workers.solver.polish import Fit, cost_of, polish
from workers.solver.problem import FitProblem
from workers.solver.random_streams import stream_key

Floats = NDArray[np.float64]
_BATCH: Final = 256
_AT_ONCE: Final = 2**20
"""Numbers of one array: a batch of 100,000 pairs would take gigabytes, and seconds without a look at `stop`."""
_MOST_SAMPLES: Final = 4096
_CONFIDENCE: Final = 0.9999
# Shares of the image's diagonal. The linear cameras know no tangential distortion and, the fisheye's, no centre.
_INLIER_SHARE: Final = {"pinhole": 0.01, "brown_conrady": 0.02, "kannala_brandt": 0.02}
_REFITS: Final = 4
_FINALISTS: Final = 3


def baseline(problem: FitProblem) -> Fit:
    """Least squares from the centre of the bounds, with no search before it."""
    return polish(problem, 0.5 * (problem.lower + problem.upper))


def linear_baseline(problem: FitProblem) -> Fit | None:
    """Least squares from a linear camera fitted to the pairs that RANSAC kept; None where no camera fits them.

    Direct linear transformation (Hartley and Zisserman 2004, algorithm 7.1) for `pinhole` and `brown_conrady`, the
    radial alignment of Tsai 1987 for `kannala_brandt` (it needs no perspective, so any field of view does), each
    inside RANSAC (Fischler and Bolles 1981). Reproducible: the samples follow from the problem's seed.
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
    if len(used) < MINIMAL[problem.model]:
        return []
    centre = 0.5 * (problem.lower + problem.upper)[8:10]
    threshold = _INLIER_SHARE[problem.model] * problem.diagonal_px
    found: list[Floats] = []
    for kept in _consensus(problem, points, marks, centre, threshold):
        camera = camera_of(problem.model, points[kept], marks[kept], centre)
        if camera is not None:
            found.append(_parameters(problem, camera))
    return found


def _consensus(
    problem: FitProblem, points: Floats, marks: Floats, centre: Floats, threshold: float
) -> list[NDArray[np.bool_]]:
    """RANSAC: masks (N,) of the pairs that the best few linear cameras explain, refitted to their inliers."""
    rng = np.random.Generator(np.random.Philox(key=int(stream_key(problem, -1, 0))))
    n, size = len(points), MINIMAL[problem.model]
    best: list[tuple[int, NDArray[np.bool_]]] = []
    drawn, needed = 0, _MOST_SAMPLES
    while drawn < needed:
        masks = _sampled(problem, rng, points, marks, centre, threshold)
        drawn += _BATCH
        for index in np.argsort(-masks.sum(axis=1), kind="stable")[:_FINALISTS]:
            mask = _refitted(problem, points, marks, centre, threshold, masks[index])
            best.append((int(mask.sum()), mask))
        best = sorted(best, key=lambda one: -one[0])[:_FINALISTS]
        share = best[0][0] / n
        failing = min(max(1.0 - share**size, 1e-12), 1.0 - 1e-12)
        needed = min(_MOST_SAMPLES, int(log(1.0 - _CONFIDENCE) / log(failing)) + 1)
    return [mask for count, mask in best if count > size]


def _sampled(
    problem: FitProblem,
    rng: np.random.Generator,
    points: Floats,
    marks: Floats,
    centre: Floats,
    threshold: float,
) -> NDArray[np.bool_]:
    """Masks (_BATCH, N) of the pairs that linear cameras of random samples explain."""
    masks = np.empty((_BATCH, len(points)), dtype=np.bool_)
    rows = max(1, _AT_ONCE // len(points))
    for first in range(0, _BATCH, rows):
        problem.stop.check()
        part = masks[first : first + rows]
        picks = np.argsort(rng.random(part.shape), axis=1)[:, : MINIMAL[problem.model]]
        cameras = fit_linear(problem.model, points[picks], marks[picks], centre)
        np.less(linear_distances(problem.model, cameras, points, marks, centre), threshold, out=part)
    return masks


def _refitted(
    problem: FitProblem, points: Floats, marks: Floats, centre: Floats, threshold: float, mask: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    for _ in range(_REFITS):
        problem.stop.check()
        if mask.sum() < MINIMAL[problem.model]:
            break
        camera = fit_linear(problem.model, points[mask][None], marks[mask][None], centre)
        again = linear_distances(problem.model, camera, points, marks, centre)[0] < threshold
        if again.sum() <= mask.sum():
            break
        mask = again
    return mask


def _parameters(problem: FitProblem, camera: Camera) -> Floats:
    # The linear camera's parts in the search's parameters; the distortion it does not know starts at zero.
    p = np.zeros(len(problem.names))
    if problem.search == "euler":
        p[:3] = euler_from_rotation(camera.R)
    else:
        p[:3] = vector_from_rotation(camera.R @ problem.nominal.R.T)
    p[3:6], p[6:10] = camera.t, camera.intrinsics
    if problem.model == "kannala_brandt":
        p[10] = camera.k1
    return np.clip(p, problem.lower, problem.upper)
