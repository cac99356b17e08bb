"""Projections of fixed points around the LiDAR, by which any two results of a vehicle are compared in pixels."""

from dataclasses import replace
from functools import cache
from math import cos, radians, sin

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.camera_models import ANGLES
from apexcal.documents.precision import FIELD_AZIMUTHS_DEG, FIELD_ELEVATIONS_DEG, FIELD_RANGES_M, Field
from workers.solver.problem import FitProblem
from workers.solver.residuals import predict, residuals_and_jacobian
from workers.solver.uncertainty import turns_are_free

Floats = NDArray[np.float64]


def field(problem: FitProblem, p: Floats, covariance: Floats) -> Field | None:
    """The points that the image shows: `number` among all, pixels `u` and `v`, and the stated deviation `sigma_px`.

    The points are the same for every result: every 10 degrees of azimuth and elevation, 5 and 20 m away. `sigma_px`
    is the root mean square over u and v, under the parameters p (D,) and their covariance (F, F) in degrees, metres
    and pixels. None if no point is in the image or nothing is free.
    """
    points = _points()
    everywhere = _at(problem, points)
    pixels, violation = predict(everywhere, p)
    size = np.array(problem.image_size)
    inside = (violation == 0.0) & np.all((pixels >= -0.5) & (pixels <= size - 0.5), axis=1)
    if not inside.any() or not covariance.size:
        return None
    J = residuals_and_jacobian(everywhere, p, turns_are_free(problem))[1].reshape(len(points), 2, -1)
    # The covariance is in people's units: degrees.
    unit = np.array([radians(1.0) if name in ANGLES else 1.0 for name in problem.names])
    shown = (J * unit)[inside][:, :, problem.free]
    variance = np.einsum("nij,jk,nik->n", shown, covariance, shown)
    sigma: Floats = np.sqrt(np.maximum(variance, 0.0) / 2.0)
    return Field(
        number=np.flatnonzero(inside).tolist(),
        u=_rounded(pixels[inside, 0]),
        v=_rounded(pixels[inside, 1]),
        sigma_px=_rounded(sigma),
    )


def _rounded(values: Floats) -> list[float]:
    return [round(value, 4) for value in values.tolist()]


def _at(problem: FitProblem, points: Floats) -> FitProblem:
    count = len(points)
    plain = replace(problem, covariances=None, whitening=None, blocks=None, velocities=None, people=None)
    return replace(plain, points=points, pixels=np.zeros((count, 2)), weights=np.ones(count))


@cache
def _points() -> Floats:
    return np.array(
        [
            (r * cos(radians(e)) * cos(radians(a)), r * cos(radians(e)) * sin(radians(a)), r * sin(radians(e)))
            for r in FIELD_RANGES_M
            for e in FIELD_ELEVATIONS_DEG
            for a in FIELD_AZIMUTHS_DEG
        ]
    )
