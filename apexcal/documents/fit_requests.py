"""The request of one fit: the service resolves it once, and the worker reads the same class.

Nothing but :func:`fit_request` knows a default of a fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, pi, radians
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from apexcal.documents.base import Magnitude, first_fault
from apexcal.documents.bounds import DEFAULT_ROTATION_RANGE_DEG, BoundsPreset, Interval
from apexcal.documents.calibrations import Prior
from apexcal.documents.camera_models import (
    ModelName,
    SearchForm,
    bare_name,
    parameter_names,
    parse_model,
    parse_search_form,
)
from apexcal.documents.common_errors import CommonError
from apexcal.documents.errors import DocumentError
from apexcal.documents.rules import Loss, OutlierRule, Weights
from apexcal.documents.schedules import Schedule, parse_preset, schedule_of
from apexcal.documents.transforms import Transform

# A hundredth of the image's diagonal: far above an honest mark's noise, far below a wrong corner.
_SATURATION_SHARE: Final = 0.01

Pixels = Annotated[float, Field(gt=0)]
Deviation = Annotated[float, Field(ge=0)]


class FitRequest(BaseModel):
    """One model on one camera's pairs, complete: no member has a default. Radians, metres and pixels.

    ``nominal``: T_camera_lidar, about which ``bounds_preset`` and ``rotation_range_rad`` bound the search.
    ``bounds`` replace single ones of these. ``unstated``: parameters of which nothing is said, so that weak priors
    may hold them. The search minimises ``loss``, which saturates at ``saturation_px``. ``mark_sigma_px``: noise of
    marks that state none, each coordinate. ``common_errors``: standard deviations in the units of their names.
    ``stated_lens``: {"model", "f_x", ...}, or {"unused": why}.
    ``folds``: into how many parts the pairs are cut; ``fold``: the part that
    is held out, -1 for none.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    camera: str
    model: ModelName
    image_size: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]]
    nominal: Transform
    search: SearchForm
    bounds_preset: BoundsPreset
    rotation_range_rad: Annotated[float, Field(gt=0, le=pi)]
    bounds: dict[str, Interval]
    locked: dict[str, Magnitude]
    priors: dict[str, Prior]
    unstated: list[str]
    loss: Loss
    saturation_px: Pixels
    outliers: OutlierRule
    weights: Weights
    mark_sigma_px: Pixels
    common_errors: dict[CommonError, Deviation]
    line_time_us: float
    stated_lens: dict[str, Any] | None
    schedule: Schedule
    seed: Annotated[int, Field(ge=0)]
    folds: Annotated[int, Field(ge=0)]
    fold: Annotated[int, Field(ge=-1)]


def fit_request(
    model: str,
    image_size: tuple[int, int],
    nominal: Mapping[str, Any],
    *,
    camera: str = "",
    preset: str = "default",
    search: SearchForm | None = None,
    bounds_preset: BoundsPreset | None = None,
    rotation_range_deg: float = DEFAULT_ROTATION_RANGE_DEG,
    bounds: Mapping[str, Any] | None = None,
    locked: Mapping[str, float] | None = None,
    priors: Mapping[str, Any] | None = None,
    loss: Loss | None = None,
    saturation_px: float | None = None,
    outliers: OutlierRule | None = None,
    weights: Weights = "equal",
    mark_sigma_px: float = 1.0,
    common_errors: Mapping[CommonError, float] | None = None,
    line_time_us: float = 0.0,
    stated_lens: Mapping[str, Any] | None = None,
    schedule: Mapping[str, Any] | None = None,
    seed: int = 0,
    folds: int = 0,
    fold: int = -1,
) -> FitRequest:
    """Return the request with everything filled in that the preset means.

    ``nominal``: a transform document. ``bounds`` {name: (lower, upper)}, ``locked`` {name: value} and ``priors``
    {name: {"mean", "sigma"}} go by parameter name, in radians, or in degrees with ``_deg`` behind the name. A locked
    parameter keeps no prior: its constant row would count among the residuals as noise of the marks.

    Raises:
        DocumentError: ``unknown_model``, ``unknown_preset``, ``unknown_search_form``, ``bad_schedule``,
            ``bad_fit_request``.
    """
    name, of = parse_model(model), parse_preset(preset)
    form = parse_search_form(search or of.search)
    intervals, values, prior_values = in_radians(bounds or {}), in_radians(locked or {}), in_radians(priors or {})
    fixed = values.keys() | {name for name, ends in intervals.items() if len(set(ends)) == 1}
    stated = intervals.keys() | fixed | prior_values.keys()
    try:
        return FitRequest(
            camera=camera,
            model=name,
            image_size=image_size,
            nominal=Transform.model_validate(nominal),
            search=form,
            bounds_preset=bounds_preset or of.bounds,
            rotation_range_rad=radians(rotation_range_deg),
            bounds=intervals,
            locked=values,
            priors={name: prior for name, prior in prior_values.items() if name not in fixed},
            unstated=[
                parameter for parameter in parameter_names(name, form) if of.weak_priors and parameter not in stated
            ],
            loss=loss or of.loss,
            saturation_px=saturation_px or _SATURATION_SHARE * hypot(*image_size),
            outliers=outliers or of.outliers,
            weights=weights,
            mark_sigma_px=mark_sigma_px,
            common_errors=dict(common_errors or {}),
            line_time_us=line_time_us,
            stated_lens=None if stated_lens is None else dict(stated_lens),
            schedule=schedule_of(of, schedule or {}),
            seed=seed,
            folds=folds,
            fold=fold,
        )
    except ValidationError as error:
        path, wrong = first_fault(error)
        raise DocumentError("bad_fit_request", f"`{path}` of the fit: {wrong}.", "") from error


def in_radians(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values under the parameters' own names, with degrees converted to radians."""
    return {bare_name(name): _radians(value) if bare_name(name) != name else value for name, value in values.items()}


def _radians(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: radians(number) for name, number in value.items()}
    return [radians(number) for number in value] if isinstance(value, list | tuple) else radians(value)
