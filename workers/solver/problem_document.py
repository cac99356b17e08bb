"""The problem of a stored request: plain JSON in, a checked `FitProblem` out."""

from collections.abc import Mapping
from math import radians
from typing import Any, Final, cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from apexcal.documents.bounds import DEFAULT_ROTATION_RANGE_DEG, Interval
from apexcal.documents.camera_models import ANGLES
from apexcal.documents.errors import DocumentError
from apexcal.documents.rules import Loss, OutlierRule, Weights
from apexcal.documents.schedules import parse_preset, schedule_of
from workers.geometry.models import parse_model, parse_search_form
from workers.geometry.projection import image_diagonal_px
from workers.geometry.transforms import from_document
from workers.solver.bounds import narrowed, parse_bounds_preset, preset_bounds
from workers.solver.common_errors import parse_common_errors
from workers.solver.covariances import Covariances
from workers.solver.errors import SolveError
from workers.solver.problem import FitProblem

_KEYS: Final = frozenset(
    {
        *("model", "camera", "fold", "seed", "search", "rotation_range_deg", "bounds_preset", "bounds", "locked"),
        *("priors", "loss", "saturation_px", "mark_sigma_px", "outliers", "weights", "preset", "schedule"),
        *("image_size", "nominal", "common_errors", "line_time_us", "stated_lens"),
    }
)


def problem_from_document(
    document: Mapping[str, Any],
    points: ArrayLike,
    pixels: ArrayLike,
    weights: ArrayLike | None = None,
    covariances: Covariances | None = None,
) -> FitProblem:
    """The problem of a stored request (plain JSON, merged with its rig) and its pairs.

    Keys: model, image_size, nominal (a transform document T_camera_lidar); and with defaults camera, fold (-1: all
    pairs), seed, search, rotation_range_deg, bounds_preset, bounds {name: [lower, upper]}, locked {name: value},
    priors {name: {"mean", "sigma"}}, loss, saturation_px, mark_sigma_px, outliers (keep or exclude), weights (equal,
    or covariances: those given), common_errors {name: sigma}, line_time_us, stated_lens {"model",
    "f_x", ...}, preset, schedule {...}. Angles are in radians, or in degrees where their name ends in `_deg`. A
    parameter that is locked keeps no prior. What the request leaves out is the preset's. Raises SolveError.
    """
    try:
        return _read(document, points, pixels, weights, covariances)
    except SolveError:
        raise
    except DocumentError as error:
        raise SolveError(error.code, error.message, error.hint) from error
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise SolveError(
            "bad_document",
            f"The request cannot be read: {type(error).__name__} {error}.",
            "It needs model, image_size [width, height] and nominal (a transform document).",
        ) from error


def _read(
    document: Mapping[str, Any],
    points: ArrayLike,
    pixels: ArrayLike,
    weights: ArrayLike | None,
    covariances: Covariances | None,
) -> FitProblem:
    unknown = [key for key in document if key not in _KEYS]
    if unknown:
        raise SolveError(
            "bad_document", f"The request has no key {unknown[0]!r}.", f"Keys: {', '.join(sorted(_KEYS))}."
        )
    model = parse_model(document["model"])
    preset = parse_preset(document.get("preset") or "default")
    search = parse_search_form(document.get("search") or preset.search)
    nominal = from_document(document["nominal"])
    width, height = (int(size) for size in document["image_size"])
    overrides = {
        name: _interval(name, pair) for name, pair in _in_radians(document.get("bounds"), _scale_all).items()
    }
    bounds = preset_bounds(
        parse_bounds_preset(document.get("bounds_preset") or preset.bounds),
        model,
        search,
        (width, height),
        nominal,
        float(document.get("rotation_range_deg") or DEFAULT_ROTATION_RANGE_DEG),
    )
    marks = np.ascontiguousarray(pixels, dtype=np.float64)
    bounds = narrowed(bounds, overrides)
    locked = {n: float(v) for n, v in _in_radians(document.get("locked"), _scale_one).items()}
    # A locked parameter needs no prior; its constant row would count among the residuals as noise of the marks.
    fixed = locked.keys() | {name for name, (lower, upper) in bounds.items() if lower == upper}
    priors: dict[str, tuple[float, float]] = _in_radians(document.get("priors"), _scale_prior)
    return FitProblem(
        model=model,
        search=search,
        nominal=nominal,
        image_size=(width, height),
        points=np.ascontiguousarray(points, dtype=np.float64),
        pixels=marks,
        weights=np.ones(len(marks)) if weights is None else np.ascontiguousarray(weights, dtype=np.float64),
        bounds=bounds,
        locked=locked,
        priors={name: prior for name, prior in priors.items() if name not in fixed},
        loss=_parse_loss(document.get("loss") or preset.loss),
        schedule=schedule_of(preset, document.get("schedule") or {}),
        seed=int(document.get("seed") or 0),
        camera=str(document.get("camera") or ""),
        fold=int(document.get("fold", -1) if document.get("fold") is not None else -1),
        # A hundredth of the image's diagonal: far above an honest mark's noise, far below a wrong corner.
        saturation_px=float(document.get("saturation_px") or 0.01 * image_diagonal_px((width, height))),
        mark_sigma_px=float(document.get("mark_sigma_px") or 1.0),
        outliers=_parse_outlier_rule(document.get("outliers") or preset.outliers),
        unstated=frozenset()
        if document.get("preset") == "paper"
        else frozenset(bounds) - overrides.keys() - fixed - priors.keys(),
        common_errors=parse_common_errors(document.get("common_errors")),
        line_time_us=float(document.get("line_time_us") or 0.0),
        stated_lens=document.get("stated_lens"),
        covariances=_weighed_by(document.get("weights") or "equal", covariances),
    )


def _scale_one(value: Any, factor: float) -> float:
    return float(value) * factor


def _scale_all(values: Any, factor: float) -> tuple[float, ...]:
    return tuple(float(value) * factor for value in values)


def _scale_prior(value: Any, factor: float) -> tuple[float, float]:
    return float(value["mean"]) * factor, float(value["sigma"]) * factor


def _in_radians(given: Any, scale: Any) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for name, value in cast("Mapping[str, Any]", given or {}).items():
        bare = name.removesuffix("_deg")
        if bare != name and bare in ANGLES:
            result[bare] = scale(value, radians(1.0))
        else:
            result[name] = scale(value, 1.0)
    return result


def _interval(name: str, pair: tuple[float, ...]) -> Interval:
    if len(pair) != 2:
        raise SolveError("bad_document", f"The bounds of {name} are not [lower, upper].", "")
    return pair[0], pair[1]


def _parse_loss(name: object) -> Loss:
    for loss in get_args(Loss):
        if name == loss:
            return loss
    known = ", ".join(get_args(Loss))
    raise SolveError("unknown_loss", f"There is no loss named {name!r}.", f"The losses are {known}.")


def _parse_outlier_rule(name: object) -> OutlierRule:
    for rule in get_args(OutlierRule):
        if name == rule:
            return rule
    raise SolveError("bad_document", f"`outliers` is {name!r}.", "It is keep or exclude.")


def _weighed_by(name: object, covariances: Covariances | None) -> Covariances | None:
    if name not in get_args(Weights):
        raise SolveError("bad_document", f"`weights` is {name!r}.", "It is equal or covariances.")
    if name == "covariances" and covariances is None:
        raise SolveError("no_covariances", "No covariances came with the pairs.", "Ask for equal weights.")
    return covariances if name == "covariances" else None
