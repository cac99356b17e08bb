"""Checks of bounds, locks and priors by parameter name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from apexcal.documents.bounds import LEAST_FOCAL_PX, Interval, preset_bounds
from apexcal.documents.camera_models import ANGLES, FOCAL_AND_CENTRE, ModelName, SearchForm, all_names, bare_name
from apexcal.documents.fit_requests import FitRequest, in_radians
from service.platform.http.problems import unprocessable

_OF_LENS = (
    "The stated lens has this value: is it in pixels of these images? If so, give the rig bounds of {} around it, or "
    "take the lens as bounds (intrinsics_as: bounds; --intrinsics-as bounds)."
)


def check_names(
    parameters: Mapping[str, Any], where: str, models: Iterable[ModelName], search: SearchForm
) -> dict[str, Any]:
    """The values by parameter name, angles in radians; every name must be a parameter of one of the models.

    Raises:
        Problem: 422 ``unknown_parameter``.
    """
    names = all_names(models, search)
    for name in parameters:
        if bare_name(name) not in names:
            raise unprocessable(
                "unknown_parameter",
                f"{where} names {name!r}, which is no parameter of {' or '.join(models)} in the form {search}.",
                f"The parameters are {', '.join(names)}; angles are in radians, or in degrees with _deg behind.",
                parameters=list(names),
            )
    values = in_radians(parameters)
    if len(values) < len(parameters):
        raise unprocessable(
            "unknown_parameter", f"{where} names an angle twice, in radians and in degrees.", "Give it once."
        )
    return values


def check_order(bounds: Mapping[str, Interval]) -> None:
    """Refuse bounds whose lower end is not below the upper end: 422 ``bounds_inside_out``."""
    for name, (low, high) in bounds.items():
        if not low < high:
            raise unprocessable(
                "bounds_inside_out",
                f"The bounds of {name} are inside out: the lower end {low:g} is not below the upper end {high:g}.",
                "Give them as [lower, upper]; a parameter that is known goes into `locked`.",
            )


def check_locks(locked: Mapping[str, float], bounds: Mapping[str, Interval]) -> None:
    """Refuse what is wrong whatever the camera: 422 ``locked_out_of_bounds``.

    ``bounds`` are those that the request itself gives.
    """
    for name, value in locked.items():
        if name in ("f_x", "f_y") and value < LEAST_FOCAL_PX:
            raise unprocessable(
                "locked_out_of_bounds",
                f"{name} is locked at {value:g}, and no camera has a focal length below {LEAST_FOCAL_PX:g} px.",
                "It is half the image's width over the tangent of half its angle of view, in pixels.",
                parameter=name,
            )
        if name in bounds:
            _check(name, value, bounds[name], "the request's own bounds", "")


def check_camera_locks(
    fit: FitRequest, locked: Mapping[str, float], bounds: Mapping[str, Interval], rig: Mapping[str, Interval]
) -> None:
    """Refuse what lies where this camera would not be looked for: 422 ``locked_out_of_bounds``.

    ``locked`` and ``bounds`` are the template's own. ``rig`` are this camera's bounds in its rig, which go before the
    preset's. Of a stated lens only focal lengths and centre are checked: any distortion may be right that was
    measured.
    """
    # Any angle about the nominal mount may be right where it looks straight ahead: it has several then.
    preset = preset_bounds(
        fit.bounds_preset,
        fit.model,
        fit.search,
        fit.image_size,
        fit.nominal.translation_m,
        reach=fit.rotation_range_rad,
    )
    for name, value in fit.locked.items():
        if name in bounds or name not in {*locked, *FOCAL_AND_CENTRE}:
            continue
        whose = "the rig's bounds" if name in rig else f"the bounds of {fit.bounds_preset}"
        hint = "" if name in locked else _OF_LENS
        _check(name, value, rig.get(name) or preset[name], whose, f" of {fit.camera}", hint)


def _check(name: str, value: float, interval: Interval, whose: str, of: str, hint: str = "") -> None:
    low, high = interval
    if low <= value <= high:
        return
    unit = " rad" if name in ANGLES else ""
    raise unprocessable(
        "locked_out_of_bounds",
        f"{name}{of} is locked at {value:g}{unit}, outside of [{low:g}, {high:g}]{unit}, {whose}.",
        hint.format(name)
        or f"Correct it; where it is right, give bounds of {name} that hold it, in the request or the rig.",
        parameter=name,
        bounds=[low, high],
    )
