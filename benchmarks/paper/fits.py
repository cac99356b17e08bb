"""The house's solver on those pairs, and how far what it fitted is from the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.fit_requests import fit_request
from apexcal.geometry.se3 import SE3
from benchmarks.paper.pairs import CLICK_PX, Pairs, weights_of
from benchmarks.paper.recordings import request_of
from workers.geometry.models import ModelName
from workers.geometry.projection import distances_px, image_diagonal_px, project
from workers.simulation.camera import SimulatedCamera
from workers.solver.polish import polish
from workers.solver.problem import fit_problem
from workers.solver.residuals import transform_of
from workers.solver.schedule import run_schedule
from workers.solver.solution import lens_of

Floats = NDArray[np.float64]

# A few slots and the polish: more iterations end in the same optimum.
_SCHEDULE: Final = {"slots": 3, "max_iterations": 2}


@dataclass(frozen=True, eq=False)
class Fitted:
    """A calibration: model, intrinsics document and T_camera_lidar."""

    model: ModelName
    intrinsics: dict[str, Any]
    transform: SE3
    pairs: int

    def project(self, points: Floats) -> tuple[Floats, Floats]:
        """Pixels (N, 2) and violations (N,) of points (N, 3) in the LiDAR frame."""
        return project(self.model, self.intrinsics, self.transform.apply(points))


def fit(pairs: Pairs, model: ModelName, seed: int) -> Fitted:
    """Search and polish; pairs whose vertices state a covariance are then weighed by it in one more polish."""
    request = {**request_of(model), "seed": seed, "schedule": _SCHEDULE, "mark_sigma_px": CLICK_PX}
    problem = fit_problem(fit_request(**request), pairs.points, pairs.marks)
    state, _ = run_schedule(problem)
    p = polish(problem, state.best_parameters).parameters
    if np.isfinite(pairs.covariance).any():
        weights = weights_of(pairs, lens_of(problem, np.array(p)).f_x)
        p = polish(fit_problem(fit_request(**request), pairs.points, pairs.marks, weights), p).parameters
    found = np.array(p)
    return Fitted(
        model, lens_of(problem, found).model_dump(exclude_unset=True), transform_of(problem, found), len(pairs.points)
    )


def errors_on(fitted: Fitted, pairs: Pairs) -> Floats:
    """(N,) distances in px between marks and projections."""
    pixels, violation = fitted.project(pairs.points)
    return distances_px(pixels, violation, pairs.marks, image_diagonal_px(fitted.intrinsics["image_size"]))


def errors_of_truth(fitted: Fitted, camera: SimulatedCamera, points: Floats) -> Floats:
    """(M,) distances in px from the true projections of points (N, 3) that the true camera sees; no marks at all."""
    truly = camera.project(points)
    seen = camera.sees(truly)
    pixels, violation = fitted.project(points[seen])
    return distances_px(pixels, violation, truly[seen], image_diagonal_px(fitted.intrinsics["image_size"]))
