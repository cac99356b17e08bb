"""A result's stated deviation over the ground and over the image, px, on regular grids."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.camera_models import ANGLES
from apexcal.geometry.se3 import from_document
from workers.geometry.models import parse_model
from workers.geometry.projection import unproject
from workers.reports.material import FittedModel
from workers.reports.rounding import rounded
from workers.solver.residuals import predict, residuals_and_jacobian
from workers.solver.uncertainty import turns_are_free

Floats = NDArray[np.float64]
GROUND: Final = (40, 30)
IMAGE: Final = (32, 18)
_MARGIN: Final = 0.08
# If the projection of a pixel's ray misses the pixel by more, the lens model has no ray there.
_NO_RAY_PX: Final = 0.1


def ground_map(model: FittedModel, pairs: dict[str, Any]) -> dict[str, Any]:
    """Over the rectangle of the pairs in the LiDAR's x and y, at their median height: m, and px or null."""
    x, y, z = (np.asarray(pairs[name], np.float64) for name in "xyz")
    columns, rows = GROUND
    xs, ys = _centres(x, columns), _centres(y, rows)
    height = float(np.median(z))
    at = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    points = np.column_stack([at, np.full(len(at), height)])
    inside, sigma = deviation_px(model, points)
    return _grid(xs, ys, np.where(inside, sigma, np.nan)) | {"z": height}


def image_map(model: FittedModel, pairs: dict[str, Any]) -> dict[str, Any]:
    """Over the image, for points as far from the camera as the median pair: px at px, or null; ``distance_m``."""
    lens = model.result.intrinsics
    width, height = lens.image_size
    columns, rows = IMAGE
    us = (np.arange(columns) + 0.5) * width / columns - 0.5
    vs = (np.arange(rows) + 0.5) * height / rows - 0.5
    pixels = np.stack(np.meshgrid(us, vs), axis=-1).reshape(-1, 2)
    rays, miss = unproject(parse_model(lens.model), lens.by_name(), pixels)
    mount = from_document(model.result.transform)
    in_camera = mount.apply(np.column_stack([pairs["x"], pairs["y"], pairs["z"]]))
    distance = float(np.median(np.linalg.norm(in_camera, axis=1)))
    _, sigma = deviation_px(model, mount.inverse().apply(distance * rays))
    return _grid(us, vs, np.where(miss < _NO_RAY_PX, sigma, np.nan)) | {"distance_m": distance}


def deviation_px(model: FittedModel, points: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Whether points (N, 3), m in the LiDAR's frame, lie in the image, and how well the result places them, px.

    One standard deviation, as a length over both axes, from the result's covariance; NaN where that is open.
    """
    problem, result = model.problem, model.result
    plain = replace(problem, covariances=None, whitening=None, blocks=None, velocities=None, people=None)
    everywhere = replace(plain, points=points, pixels=np.zeros((len(points), 2)), weights=np.ones(len(points)))
    p = np.array([result.polished.parameters[name] for name in problem.names])
    pixels, violation = predict(everywhere, p)
    size = np.array(problem.image_size)
    inside = (violation == 0.0) & np.all((pixels >= -0.5) & (pixels <= size - 0.5), axis=1)
    covariance = np.array(result.covariance.matrix)
    if not covariance.size or None in result.std.values():
        return inside, np.full(len(points), np.nan)
    J = residuals_and_jacobian(everywhere, p, turns_are_free(problem), walls=False)[1].reshape(len(points), 2, -1)
    # The covariance is in people's units: degrees.
    unit = np.array([radians(1.0) if name in ANGLES else 1.0 for name in problem.names])
    shown = (J * unit)[:, :, problem.free]
    variance = np.einsum("nij,jk,nik->n", shown, covariance, shown)
    return inside, np.where(violation == 0.0, np.sqrt(np.maximum(variance, 0.0)), np.nan)


def _centres(values: Floats, count: int) -> Floats:
    low, high = float(values.min()), float(values.max())
    margin = max(_MARGIN * (high - low), 0.5)
    return np.linspace(low - margin, high + margin, count)


def _grid(across: Floats, down: Floats, values: Floats) -> dict[str, Any]:
    table = values.reshape(len(down), len(across))
    return {"across": rounded(across), "down": rounded(down), "sigma_px": [rounded(row) for row in table]}
