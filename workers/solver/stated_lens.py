# pyright: reportMissingTypeStubs=false
"""The mount under a lens that somebody stated, and whether the pairs bear that lens out.

A vehicle whose driver publishes a lens projects through it whatever was fitted here. A mount and a lens that were
fitted together hold together only, so such a vehicle needs the mount that was fitted under its own lens.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special

from apexcal.documents.bounds import Interval, preset_bounds
from apexcal.documents.camera_models import FOCAL_AND_CENTRE
from apexcal.documents.checks import USE_LIMIT_M, USE_LIMIT_PX, USE_LIMIT_RAD, figure
from apexcal.documents.results import Intrinsics, StatedLensFit
from apexcal.documents.rules import LensOrigin
from apexcal.documents.transforms import SolvedTransform
from apexcal.geometry.se3 import to_document
from workers.geometry.models import INTRINSICS, ModelName, parse_model
from workers.geometry.projection import project
from workers.solver.estimate import Estimate, estimate
from workers.solver.outcomes import SolveError
from workers.solver.polish import mean_and_rms, weighted_residuals
from workers.solver.prediction import DISTANCES_M, deviations_along
from workers.solver.problem import FitProblem
from workers.solver.residuals import transform_of
from workers.solver.weighting import whitened

Floats = NDArray[np.float64]
# scipy publishes no types.
_chance_above: Callable[[float, float, float], float] = special.fdtrc
_CHANCE: Final = 1e-3
"""How often the pairs of a true lens speak against it."""
_SURE: Final = 2.0  # deviations of the lens of the pairs, by which points may differ without saying anything
_FIELD: Final = 0.95  # of the marked field


def lens_origin(problem: FitProblem) -> LensOrigin:
    """Whether the request locks the lens, draws it to values, or leaves it to the pairs. Skew does not count."""
    names = INTRINSICS[problem.model]
    if all(name in problem.locked for name in names if name != "skew"):
        return "stated"
    is_drawn = all(name in problem.priors or name in problem.locked for name in FOCAL_AND_CENTRE)
    return "stated, refined" if is_drawn else "fitted"


def under_stated_lens(problem: FitProblem, fitted: Estimate) -> StatedLensFit | None:
    """The mount of the same pairs under the problem's `stated_lens`, from `fitted`, the estimate of the problem.

    Both fits are least squares on the pairs that hold `fitted`. The stated lens is compared with the lens that these
    pairs alone show: with `fitted`, or if a lock or prior holds its lens, with a fit without them. Its misfit is what
    it adds to the residuals (F test of nested models; Seber and Wild 2003, ch. 5). None if no lens is stated.
    """
    lens = problem.stated_lens
    if lens is None:
        return None
    of_pairs = replace(problem, weights=fitted.holding.weights, loss=fitted.holding.loss, outliers="keep")
    model = parse_model(lens["model"])
    locked = {name: float(lens[name]) for name in INTRINSICS[model]}
    mount = _fitted(of_pairs, model, fitted.held_at, locked, {name: (v, v) for name, v in locked.items()})
    p = mount.parameters
    return StatedLensFit(
        **dict(mount.spread.precision()),
        **_misfit(mount, _with_free_lens(of_pairs, fitted)),
        intrinsics=Intrinsics.model_validate({"model": model, "image_size": problem.image_size, **locked}),
        transform=SolvedTransform.model_validate(to_document(transform_of(mount.fitted, p))),
        rms_px=mean_and_rms(mount.fitted, p)[1],
    )


def _fitted(
    problem: FitProblem,
    model: ModelName,
    start: Floats,
    lens: Mapping[str, float],
    bounds: dict[str, Interval],
) -> Estimate:
    """The estimate under bounds of the whole lens, without its locks and priors; it starts from mount and `lens`."""
    mount = problem.names[:6]
    here = replace(
        problem,
        model=model,
        bounds={name: problem.bounds[name] for name in mount} | bounds,
        locked={name: value for name, value in problem.locked.items() if name in mount},
        priors={name: value for name, value in problem.priors.items() if name in mount},
        unstated=frozenset(bounds),
        stated_lens=None,
    )
    return estimate(here, np.concatenate([start[:6], [lens[name] for name in INTRINSICS[model]]]))


def _with_free_lens(problem: FitProblem, fitted: Estimate) -> Estimate | None:
    """The estimate with a lens that only the pairs hold; None if they are too few for one."""
    if lens_origin(problem) == "fitted":
        return fitted
    names = INTRINSICS[problem.model]
    bounds = preset_bounds(
        "image-size", problem.model, problem.search, problem.image_size, problem.nominal.t.tolist()
    )
    skew = {"skew": problem.bounds["skew"]} if "skew" in names else {}
    lens = dict(zip(names, fitted.held_at[6:].tolist(), strict=True))
    try:
        return _fitted(problem, problem.model, fitted.held_at, lens, {name: bounds[name] for name in names} | skew)
    except SolveError:
        return None


def _misfit(mount: Estimate, free: Estimate | None) -> dict[str, Any]:
    """Whether the pairs bear the stated lens out, and a sentence."""
    if free is None or free.errors is None or free.spread.freedom is None or mount.spread.freedom is None:
        sentence = "These pairs are too few to tell whether the stated lens is true."
        return {"explains": None, "free_lens_rms_px": None, "sentence": sentence}
    of_mount, of_free = _squares(mount), _squares(free)
    at_px, free_px = (mean_and_rms(fit.fitted, fit.held_at)[1] for fit in (mount, free))
    more, left = max(mount.spread.freedom - free.spread.freedom, 1.0), free.spread.freedom
    noise = max(of_free / left, 1e-12)
    statistic = max(of_mount - of_free, 0.0) / (more * noise)
    apart = _over_limit(mount, free)
    explains = not (apart > 1.0 and _chance_above(more, left, statistic) < _CHANCE)
    sizes = f"it leaves {figure(at_px)} px RMS, a free lens {figure(free_px)} px"
    sentence = (
        f"The stated lens fits these pairs: {sizes}."
        if explains
        else f"The stated lens does not fit these pairs: {sizes}. A free lens moves points at 5 to 50 m by "
        f"{figure(apart)} times the limit."
    )
    return {"explains": explains, "free_lens_rms_px": free_px, "sentence": sentence}


def _over_limit(mount: Estimate, free: Estimate) -> float:
    """Return how far apart two fits see points of the marked field, less `free`'s error, over the limit of use."""
    problem, T = mount.fitted, transform_of(mount.fitted, mount.parameters)
    rays = T.apply(problem.points[problem.weights > 0.0])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    distances = np.array(DISTANCES_M)[:, None]
    points = T.inverse().apply((distances[:, :, None] * rays).reshape(-1, 3))
    pixels = [
        project(fit.fitted.model, fit.parameters[6:], transform_of(fit.fitted, fit.parameters).apply(points))[0]
        for fit in (mount, free)
    ]
    px = np.hypot(*(pixels[0] - pixels[1]).T).reshape(len(distances), -1) - _SURE * deviations_along(free, rays)[0]
    focal_px = float(np.sqrt(mount.parameters[6] * mount.parameters[7]))
    limit_px = np.maximum(USE_LIMIT_PX, focal_px * np.maximum(USE_LIMIT_RAD, USE_LIMIT_M / distances))
    return float(np.max(np.nanquantile(np.maximum(px, 0.0) / limit_px, _FIELD, axis=1)))


def _squares(fit: Estimate) -> float:
    """Sum of squared residuals of the marks, px^2, whitened where pairs state covariances."""
    here = whitened(fit.fitted, fit.parameters)
    residuals = weighted_residuals(here, fit.parameters)[0][: 2 * len(here.points)]
    return float(residuals @ residuals)
