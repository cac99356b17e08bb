"""LiDAR vertices that were marked in two cameras: one camera's mark, predicted from the other's."""

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.corners import TOP
from apexcal.documents.pairs import CORNER
from apexcal.geometry.se3 import SE3
from workers.geometry.models import ModelName
from workers.geometry.projection import NO_RAY_PX, project, unproject
from workers.solver.camera_transform import normal_sigmas
from workers.solver.outliers import threshold_of

Floats = NDArray[np.float64]
_STEP_PX: Final = 0.5


@dataclass(frozen=True, eq=False)
class View:
    """One camera's calibration, and the pairs that it was fitted to.

    points (N, 3) m, LiDAR frame, where each vertex was at the frame's time; pixels (N, 2); sigma_px the noise per
    pixel coordinate that its residuals show; outliers (N,) bool, the pairs judged not to belong.
    """

    model: ModelName
    intrinsics: Mapping[str, float]
    T_camera_lidar: SE3
    points: Floats
    pixels: Floats
    sigma_px: float
    outliers: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Agreement:
    """The distances of camera b's marks from where camera a's marks put the vertices.

    rows (M, 2): indices of the pairs in a and b; distances_px and scores (M,): in px, and in standard deviations of
    both cameras' noise. mean_px, rms_px, expected_rms_px, offset_px (2,) and offset_sigmas are over the `counted`
    ones, without pairs judged outliers. odd: the rows that stand out, the worst first.
    """

    rows: NDArray[np.int64]
    distances_px: Floats
    scores: Floats
    counted: int
    mean_px: float
    rms_px: float
    expected_rms_px: float
    offset_px: tuple[float, float]
    offset_sigmas: float
    odd: NDArray[np.int64]


def vertex_keys(pairs: Mapping[str, Sequence[Any]], of_one_detection: bool) -> list[Hashable]:
    """Return the keys of the pairs' vertices: in one detection sweep, moment and corner, else moment and point."""
    count = len(pairs["x"])
    names = ("stamp_ns", "sweep_index", CORNER) if of_one_detection else ("stamp_ns", "x", "y", "z")
    # A set that names no corners is of tips; another camera's set of the same detection may name them.
    missing = {CORNER: TOP}
    return list(zip(*(pairs.get(name, [missing.get(name)] * count) for name in names), strict=True))


def shared_rows(a: Sequence[Hashable], b: Sequence[Hashable]) -> NDArray[np.int64]:
    """(M, 2): indices of the pairs of the same vertex; keys that one side has twice tell nothing."""
    in_b = {key: row for row, key in enumerate(b)}
    twice = {key for keys in (a, b) for key in _repeated(keys)}
    rows = [(row, in_b[key]) for row, key in enumerate(a) if key in in_b and key not in twice]
    return np.array(rows, dtype=np.int64).reshape(-1, 2)


def agreement(a: View, b: View, rows: NDArray[np.int64]) -> Agreement | None:
    """Compare the marks of shared vertices; None where fewer than two can be compared.

    A mark in camera a is taken back to its ray, the vertex's distance along it is the LiDAR's, and that point (moved
    as the vertex moved between the two frames, where the pairing interpolates) is projected into camera b. So it is
    the angles between the cameras that are compared; the LiDAR enters with its range alone.
    """
    predicted, visible = _carried(a, b, rows, np.zeros(2))
    by_mark = np.empty((len(rows), 2, 2))
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = _STEP_PX
        ahead, ahead_seen = _carried(a, b, rows, step)
        behind, behind_seen = _carried(a, b, rows, -step)
        by_mark[:, :, axis] = (ahead - behind) / (2.0 * _STEP_PX)
        visible = visible & ahead_seen & behind_seen
    rows, by_mark = rows[visible], by_mark[visible]
    off = b.pixels[rows[:, 1]] - predicted[visible]
    covariance = b.sigma_px**2 * np.eye(2) + a.sigma_px**2 * by_mark @ by_mark.transpose(0, 2, 1)
    if len(rows) == 0 or not np.all(np.linalg.det(covariance) > 0.0):
        return None
    distances: Floats = np.hypot(off[:, 0], off[:, 1])
    scores: Floats = np.sqrt(np.einsum("ni,nij,nj->n", off, np.linalg.inv(covariance), off))
    fair = ~(a.outliers[rows[:, 0]] | b.outliers[rows[:, 1]])
    counted = int(np.count_nonzero(fair))
    if counted < 2:
        return None
    offset: Floats = np.sum(off[fair], axis=0) / counted
    of_mean: Floats = np.sum(covariance[fair], axis=0) / counted**2
    order = np.argsort(-scores, kind="stable")
    return Agreement(
        rows,
        distances,
        scores,
        counted,
        float(np.sum(distances[fair])) / counted,
        sqrt(float(np.sum(distances[fair] ** 2)) / counted),
        sqrt(float(np.trace(np.sum(covariance[fair], axis=0))) / counted),
        (float(offset[0]), float(offset[1])),
        normal_sigmas(float(offset @ np.linalg.solve(of_mean, offset)), 2),
        order[scores[order] > threshold_of(len(rows))],
    )


def _carried(a: View, b: View, rows: NDArray[np.int64], step: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    # Pixels (M, 2) in b of a's marks moved by step, and which of them are projections at all.
    in_a, in_b = rows[:, 0], rows[:, 1]
    rays, miss = unproject(a.model, a.intrinsics, a.pixels[in_a] + step)
    along = np.sum(rays * a.T_camera_lidar.apply(a.points[in_a]), axis=1)
    moved = b.points[in_b] - a.points[in_a]
    points = a.T_camera_lidar.inverse().apply(rays * along[:, None]) + moved
    pixels, violation = project(b.model, b.intrinsics, b.T_camera_lidar.apply(points))
    return pixels, (violation == 0.0) & (miss < NO_RAY_PX) & (along > 0.0)


def _repeated(keys: Sequence[Hashable]) -> set[Hashable]:
    return {key for key, count in Counter(keys).items() if count > 1}
