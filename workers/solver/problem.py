"""The problem of a fit: one frozen, checked value that every later step reads.

Its bounds are a preset's for the nominal mount, with single parameters replaced.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isfinite, pi
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from apexcal.documents import bounds
from apexcal.documents.bounds import BoundsPreset, Interval
from apexcal.documents.fit_requests import FitRequest
from apexcal.documents.rules import Loss, OutlierRule
from apexcal.documents.schedules import Schedule
from apexcal.geometry.rotations import euler_from_rotation
from apexcal.geometry.se3 import SE3, from_document
from workers.geometry.models import (
    ModelName,
    SearchForm,
    parameter_names,
)
from workers.geometry.projection import image_diagonal_px
from workers.solver.blocks import Blocks
from workers.solver.covariances import Covariances
from workers.solver.outcomes import NEVER, SolveError, Stop


def preset_bounds(
    preset: BoundsPreset,
    model: ModelName,
    form: SearchForm,
    image_size: tuple[int, int],
    nominal: SE3,
    reach: float,
) -> dict[str, Interval]:
    """(lower, upper) of every parameter of the model about a nominal T_camera_lidar; radians, metres and pixels.

    See `apexcal.documents.bounds.preset_bounds`.
    """
    angles = euler_from_rotation(nominal.R).tolist()
    return bounds.preset_bounds(preset, model, form, image_size, nominal.t.tolist(), angles, reach)


def narrowed(preset: Mapping[str, Interval], overrides: Mapping[str, Interval]) -> dict[str, Interval]:
    """The bounds with single parameters replaced. Raises SolveError for unknown names and lower > upper."""
    check_names(overrides, preset, "bounds")
    merged = dict(preset) | {name: (float(lo), float(hi)) for name, (lo, hi) in overrides.items()}
    for name, (lower, upper) in merged.items():
        if not (np.isfinite(lower) and np.isfinite(upper)):
            raise SolveError("non_finite", f"The bounds of {name} are not finite: [{lower}, {upper}].", "")
        if lower > upper:
            raise SolveError(
                "bounds_inside_out",
                f"The bounds of {name} are inside out: lower {lower} is above upper {upper}.",
                "Give them as [lower, upper].",
            )
    return merged


ASPECT: Final = "aspect"
"""f_y / f_x, which may have a prior as a parameter may."""


def check_names(values: Iterable[str], names: Mapping[str, object], where: str) -> None:
    """Raises SolveError `unknown_parameter` for a name that the model and search form do not have."""
    for name in values:
        if name not in names:
            raise SolveError(
                "unknown_parameter",
                f"`{where}` names {name!r}, which is no parameter of this model in this search form.",
                f"The parameters are {', '.join(names)}.",
            )


@dataclass(frozen=True, eq=False)
class FitProblem:
    """A fit of T_camera_lidar and the intrinsics to 3D-2D pairs.

    points (N, 3) float64, metres, LiDAR frame; pixels (N, 2) float64; weights (N,) float64 >= 0. Bounds, locks and
    priors go by parameter name in radians, metres and pixels; `bounds` holds every parameter, locked ones with
    both ends at their value. `loss` is what the genetic algorithm minimises: the weighted mean distance in pixels,
    or the mean of d / (1 + d / saturation_px). A prior (mean, sigma) weighs against marks of `mark_sigma_px`
    times `noise_scale`; the polish takes one of `ASPECT`, too.
    `outliers`: whether the polish keeps the pairs that are judged not to belong, or leaves them out.
    `covariances`: of the pairs' errors, by which they then weigh (`weighting` makes `whitening` (N, 2, 2) of them and
    sets `mark_sigma_px` to the typical pair's); without them all pairs weigh as `weights` says.
    `blocks`: the pairs that may share errors. `common_errors`: standard deviations of what all pairs share,
    by name. `velocities` (N, 3): how the apex moved at its moment, m/s in the LiDAR frame, where that is known.
    `people` (N, P): each person's share in the marks; without it all marks are one person's. `line_time_us`: from
    one row of the image to the next (`rolling_shutter` moves the points by it).
    `stated_lens`: the lens that somebody stated of the camera, {"model", "f_x", ...}, whatever holds this fit's.
    `unused_lens`: why a stated lens is no such; None where it is, or none is stated.
    `unstated`: parameters of which the request says nothing, so that weak priors may hold them (`estimate`).
    `stop`: what may end the work on it; every long computation checks it within a second.
    Raises SolveError where the parts do not make a problem that can be fitted.
    """

    model: ModelName
    search: SearchForm
    nominal: SE3
    image_size: tuple[int, int]
    points: NDArray[np.float64] = field(repr=False)
    pixels: NDArray[np.float64] = field(repr=False)
    weights: NDArray[np.float64] = field(repr=False)
    bounds: dict[str, Interval]
    locked: dict[str, float]
    priors: dict[str, tuple[float, float]]
    unstated: frozenset[str]
    loss: Loss
    saturation_px: float
    outliers: OutlierRule
    mark_sigma_px: float
    common_errors: dict[str, float]
    line_time_us: float
    stated_lens: Mapping[str, Any] | None
    schedule: Schedule
    seed: int
    camera: str
    fold: int
    noise_scale: float = 1.0
    unused_lens: str | None = None
    covariances: Covariances | None = field(default=None, repr=False)
    whitening: NDArray[np.float64] | None = field(default=None, repr=False)
    blocks: Blocks | None = field(default=None, repr=False)
    velocities: NDArray[np.float64] | None = field(default=None, repr=False)
    people: NDArray[np.float64] | None = field(default=None, repr=False)
    stop: Stop = field(default=NEVER, repr=False)

    def __post_init__(self) -> None:
        _check_pairs(self.points, self.pixels, self.weights)
        check_names(self.locked, dict.fromkeys(self.names), "locked")
        check_names(self.priors.keys() - {ASPECT}, dict.fromkeys(self.names), "priors")
        bounds = narrowed({name: self.bounds[name] for name in self.names}, {})
        object.__setattr__(self, "bounds", bounds | {name: (v, v) for name, v in self.locked.items()})
        _check_numbers(self)
        if self.covariances is not None and len(self.covariances.marks) != len(self.points):
            raise SolveError("bad_covariances", "There is not one covariance for each pair.", "")
        for rows in (self.blocks and self.blocks.labels, self.velocities, self.people):
            if rows is not None and len(rows) != len(self.points):
                raise SolveError("bad_shape", "There is not one block, velocity or row of people for each pair.", "")
        pairs, free = int(np.count_nonzero(self.weights)), len(self.free)
        if pairs < max(free, 1):
            raise SolveError(
                "too_few_pairs",
                f"There are {pairs} pairs for {free} free parameters of {self.model}.",
                "Mark more corners, or lock what is known (intrinsics, lever arm), or choose a smaller model.",
            )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameter vector, in its order."""
        return parameter_names(self.model, self.search)

    @property
    def lower(self) -> NDArray[np.float64]:
        """Lower ends of the initial bounds, in the order of `names`."""
        return self._ends[0].copy()

    @property
    def upper(self) -> NDArray[np.float64]:
        """Upper ends of the initial bounds, in the order of `names`."""
        return self._ends[1].copy()

    @property
    def free(self) -> NDArray[np.int64]:
        """Indices into `names` of the parameters that may move."""
        return self._free.copy()

    @cached_property
    def turned_points(self) -> NDArray[np.float64]:
        """Points (N, 3) turned by the nominal rotation, so that the search's rotation alone is left to apply."""
        if self.search == "euler":
            return self.points
        x, y, z = self.points.T
        # Written out: a matrix product may go through BLAS, whose bits depend on its build and threads.
        turned = [R[0] * x + R[1] * y + R[2] * z for R in self.nominal.R]
        return np.ascontiguousarray(np.stack(turned, axis=1), dtype=np.float64)

    @cached_property
    def _ends(self) -> NDArray[np.float64]:
        return np.array([self.bounds[name] for name in self.names], dtype=np.float64).T

    @cached_property
    def _free(self) -> NDArray[np.int64]:
        lower, upper = self._ends
        return np.flatnonzero(upper > lower).astype(np.int64)

    @property
    def any_rotation(self) -> bool:
        """Whether the bounds hold every rotation there is: then those of the rotation vector are no walls."""
        if self.search != "rotation_vector":
            return False
        ends = [self.bounds[name] for name in self.names[:3]]
        return all(lower <= -pi and upper >= pi for lower, upper in ends) and not any(
            name in self.priors for name in self.names[:3]
        )

    def moved_by(self, late_s: NDArray[np.float64] | float) -> FitProblem:
        """Return the problem with each point (N, 3) moved to where the apex was ``late_s`` (N,) later."""
        if self.velocities is None:
            return self
        return replace(self, points=self.points + np.reshape(late_s, (-1, 1)) * self.velocities)

    @property
    def rows_below(self) -> NDArray[np.float64]:
        """(N,) rows of the marks below the image's middle."""
        height = self.image_size[1]
        return np.clip(self.pixels[:, 1], 0.0, height - 1.0) - 0.5 * (height - 1.0)

    @property
    def diagonal_px(self) -> float:
        """Length of the image's diagonal."""
        return image_diagonal_px(self.image_size)


def fit_problem(
    request: FitRequest,
    points: ArrayLike,
    pixels: ArrayLike,
    weights: ArrayLike | None = None,
    covariances: Covariances | None = None,
) -> FitProblem:
    """Return the problem of a request and its pairs: points (N, 3) m, pixels (N, 2), weights (N,), 1 by default.

    Raises SolveError as `FitProblem`; `no_covariances` if the request weighs by covariances and there are none.
    """
    if request.weights == "covariances" and covariances is None:
        raise SolveError("no_covariances", "No covariances came with the pairs.", "Ask for equal weights.")
    nominal = from_document(request.nominal.model_dump())
    bounds = preset_bounds(
        request.bounds_preset, request.model, request.search, request.image_size, nominal, request.rotation_range_rad
    )
    marks = np.ascontiguousarray(pixels, dtype=np.float64)
    unused_lens = (request.stated_lens or {}).get("unused")
    return FitProblem(
        model=request.model,
        search=request.search,
        nominal=nominal,
        image_size=request.image_size,
        points=np.ascontiguousarray(points, dtype=np.float64),
        pixels=marks,
        weights=np.ones(len(marks)) if weights is None else np.ascontiguousarray(weights, dtype=np.float64),
        bounds=narrowed(bounds, request.bounds),
        locked=request.locked,
        priors={name: (prior.mean, prior.sigma) for name, prior in request.priors.items()},
        unstated=frozenset(request.unstated),
        loss=request.loss,
        saturation_px=request.saturation_px,
        outliers=request.outliers,
        mark_sigma_px=request.mark_sigma_px,
        common_errors=dict[str, float](request.common_errors.items()),
        line_time_us=request.line_time_us,
        stated_lens=None if unused_lens else request.stated_lens,
        unused_lens=unused_lens,
        schedule=request.schedule,
        seed=request.seed,
        camera=request.camera,
        fold=request.fold,
        covariances=covariances if request.weights == "covariances" else None,
    )


def _check_pairs(points: NDArray[np.float64], pixels: NDArray[np.float64], weights: NDArray[np.float64]) -> None:
    n = len(pixels)
    if points.shape != (n, 3) or pixels.shape != (n, 2) or weights.shape != (n,):
        raise SolveError(
            "bad_shape",
            f"Points {points.shape}, pixels {pixels.shape} and weights {weights.shape} do not belong together.",
            "Points are (N, 3), pixels (N, 2), weights (N,).",
        )
    for what, values in (("points", points), ("pixels", pixels), ("weights", weights)):
        bad = np.flatnonzero(~np.isfinite(values.reshape(n, values.size // max(n, 1))).all(axis=1))
        if bad.size:
            raise SolveError(
                "non_finite", f"The {what} of pair {bad[0]} are not finite.", f"{bad.size} pairs are affected."
            )
    if np.any(weights < 0.0):
        raise SolveError("bad_shape", "A weight is negative.", "Weights are 0 (leave out) or above.")


def _check_numbers(problem: FitProblem) -> None:
    for name, value in problem.locked.items():
        if not isfinite(value):
            raise SolveError("non_finite", f"The locked value of {name} is not finite.", "")
    for name, (mean, sigma) in problem.priors.items():
        if not isfinite(mean) or not isfinite(sigma) or sigma <= 0.0:
            raise SolveError(
                "bad_prior", f"The prior of {name} is mean {mean}, sigma {sigma}.", "sigma must be above 0."
            )
    if min(problem.image_size) < 1 or problem.saturation_px <= 0.0 or problem.mark_sigma_px <= 0.0:
        raise SolveError(
            "bad_document", "image_size, saturation_px and mark_sigma_px must be above 0.", "They are in pixels."
        )
