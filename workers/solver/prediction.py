"""The precision of a result: deviations of projections over the image, in pixels, and in mm at distances."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.precision import Halves, PredictedPixel, Prediction
from workers.geometry.projection import NO_RAY_PX, unproject
from workers.solver.estimate import Estimate
from workers.solver.problem import FitProblem
from workers.solver.residuals import by_point, residuals_and_jacobian, transform_of
from workers.solver.uncertainty import turns_are_free

Floats = NDArray[np.float64]
DISTANCES_M: Final = (5.0, 20.0, 50.0)
_COLUMNS: Final = 5
_ROWS: Final = 3


def prediction(estimate: Estimate, halves: list[Halves]) -> Prediction | None:
    """The deviations (one standard deviation, length over both axes) of projected LiDAR points.

    At the middles of 5 x 3 equal cells of the image, for points at 5, 20 and 50 m from the camera: `stated_px`, and
    `stated_mm` across the ray. `expected_over_stated`: the factor to expect from how far the halves differ, 1 if they
    differ by no more than stated. Pixels without a ray under the lens model have nulls. All of it assumes the fitted
    model. None if the pairs leave a direction open.
    """
    if estimate.errors is None:
        return None
    problem, p = estimate.holding, estimate.parameters
    width, height = problem.image_size
    u = (np.arange(_COLUMNS) + 0.5) * width / _COLUMNS - 0.5
    v = (np.arange(_ROWS) + 0.5) * height / _ROWS - 0.5
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays, miss = unproject(problem.model, p[6:], pixels)
    px, mm = deviations_along(estimate, rays)
    visible = (miss < NO_RAY_PX) & np.all(np.isfinite(px), axis=0)
    return Prediction(
        distances_m=list(DISTANCES_M),
        expected_over_stated=max([1.0, *(half.field_ratio for half in halves if not half.holds)]),
        points=[
            PredictedPixel(
                u=float(pixels[i, 0]),
                v=float(pixels[i, 1]),
                stated_px=px[:, i].tolist() if visible[i] else None,
                stated_mm=mm[:, i].tolist() if visible[i] else None,
            )
            for i in range(len(pixels))
        ],
    )


def deviations_along(estimate: Estimate, rays: Floats) -> tuple[Floats, Floats]:
    """Return (distances, R) standard deviations of projected points, px and mm across the ray, over both axes.

    The points lie at `DISTANCES_M` on rays (R, 3) of unit length in the camera's frame. The estimate states errors.
    """
    px, mm = covariances_along(estimate, rays)
    return np.sqrt(np.einsum("kncc->kn", px)), np.sqrt(np.einsum("kncc->kn", mm))


def covariances_along(estimate: Estimate, rays: Floats) -> tuple[Floats, Floats]:
    """Return covariances of those points: (distances, R, 2, 2) px^2 and (distances, R, 3, 3) mm^2."""
    _, blocks, back = derivatives_along(estimate, rays)
    return point_covariances(estimate, blocks, back)


def point_covariances(estimate: Estimate, blocks: Floats, back: Floats) -> tuple[Floats, Floats]:
    """Return covariances of the points whose derivatives `derivatives_along` gave, shaped as `covariances_along`."""
    assert estimate.errors is not None
    spread = np.einsum("ncf,fg,ndg->ncd", blocks, estimate.errors.covariance(), blocks)
    across = 1e6 * np.einsum("nic,ncd,njd->nij", back, spread, back)
    return spread.reshape(len(DISTANCES_M), -1, 2, 2), across.reshape(len(DISTANCES_M), -1, 3, 3)


def derivatives_along(estimate: Estimate, rays: Floats) -> tuple[FitProblem, Floats, Floats]:
    """Return those points as a problem, (n, 2, F) px by the free parameters, and (n, 3, 2) m by px.

    The n points are those of all rays at the first distance, at the second, and so on. The metres are the least move
    of the point that moves its pixel as much.
    """
    problem, p = estimate.holding, estimate.parameters
    # All distances at once: a problem wants more pairs than parameters.
    along = np.repeat(DISTANCES_M, len(rays))[:, None] * np.tile(rays, (len(DISTANCES_M), 1))
    there = replace(
        problem, points=transform_of(problem, p).inverse().apply(along), pixels=np.zeros((len(along), 2)),
        weights=np.ones(len(along)), covariances=None, whitening=None, blocks=None, velocities=None, people=None,
    )  # fmt: skip
    rows = residuals_and_jacobian(there, p, turns_are_free(problem), walls=False)[1][:, problem.free]
    return there, rows.reshape(len(along), 2, -1), np.asarray(np.linalg.pinv(by_point(there, p)), np.float64)
