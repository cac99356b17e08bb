"""Least squares of the mount, and of the lens where none is stated, on marks: the solver's polish from a start."""

from __future__ import annotations

from typing import Final

import numpy as np

from apexcal.documents.schedules import Schedule
from apexcal.geometry.se3 import SE3
from workers.geometry.models import INTRINSICS, parameter_names
from workers.marks.mount_search import CAMERA_FRAME, LIDAR_FRAME
from workers.marks.sights import Floats, Lens, MountedLens
from workers.solver.polish import polish
from workers.solver.problem import FitProblem, preset_bounds
from workers.solver.residuals import transform_of

_REACH_RAD: Final = np.radians(60.0)
_SATURATION_PX: Final = 15.0
_DISTORTION: Final = 0.2  # standard deviation, as `workers.solver.estimate` has it at most
_MARK_PX: Final = 1.0
_CENTRE_SHARE: Final = 0.05  # of the width: principal points of sold cameras lie within it
_FEWEST: Final = 6


def fit_mount(
    start: MountedLens, stated: Lens | None, points: Floats, marks: Floats, weights: Floats, size: tuple[int, int]
) -> MountedLens:
    """The camera that fits marks (N, 2) of points (N, 3) metres best, robustly; the start itself from too few.

    Args:
        stated: the lens, which is kept; None: it is fitted, with weak priors on what few marks do
            not determine; so few that they determine no lens keep that of the start.
        weights: (N,) of the marks.
    """
    model = start.lens.model
    names = INTRINSICS[model]
    if len(points) < _FEWEST:
        return start
    if len(points) < _FEWEST + len(names):
        stated = start.lens
    at = dict(zip(names, start.lens.intrinsics.tolist(), strict=True))
    bounds = preset_bounds("image-size", model, "rotation_vector", size, start.mount, _REACH_RAD)
    locked = at if stated is not None else {name: 0.0 for name in names if name == "skew"}
    priors: dict[str, tuple[float, float]] = {}
    if stated is None:
        priors = {name: (0.0, _DISTORTION) for name in names if name.startswith("k")}
        priors |= {
            name: (0.5 * (side - 1.0), _CENTRE_SHARE * side) for name, side in zip(("c_x", "c_y"), size, strict=True)
        }
    problem = FitProblem(
        model=model,
        search="rotation_vector",
        nominal=start.mount,
        image_size=size,
        points=np.ascontiguousarray(points),
        pixels=np.ascontiguousarray(marks),
        weights=np.ascontiguousarray(weights),
        bounds=bounds,
        locked=locked,
        priors=priors,
        unstated=frozenset(),
        loss="saturating",
        saturation_px=_SATURATION_PX,
        outliers="keep",
        mark_sigma_px=_MARK_PX,
        common_errors={},
        line_time_us=0.0,
        stated_lens=None,
        schedule=Schedule(),
        seed=0,
        camera=CAMERA_FRAME,
        fold=-1,
    )
    first = np.concatenate([np.zeros(3), start.mount.t, start.lens.intrinsics])
    p = np.array(polish(problem, first).parameters)
    assert len(p) == len(parameter_names(model, "rotation_vector"))
    mount = transform_of(problem, p)
    return MountedLens(Lens(model, p[6:].copy()), SE3(CAMERA_FRAME, LIDAR_FRAME, mount.R, mount.t))
