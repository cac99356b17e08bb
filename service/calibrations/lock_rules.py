"""Checks locked values against the bounds of the search."""

from __future__ import annotations

from collections.abc import Mapping

from apexcal.documents.bounds import LEAST_FOCAL_PX, BoundsPreset, Interval, preset_bounds
from apexcal.documents.camera_models import ANGLES, MODELS
from service.db.base import Json
from service.db.fleets import RigCamera
from service.http.problems import Problem

_OF_LENS = (
    "The lens as stated has it: is it in pixels of these images? Where it is right, give the rig bounds of {} that "
    "hold it, or take the lens as bounds (intrinsics_as: bounds; --intrinsics-as bounds)."
)


def check_locks(locked: Mapping[str, float], bounds: Mapping[str, Interval]) -> None:
    """Refuse what is wrong whatever the camera: 422 ``locked_out_of_bounds``.

    ``bounds`` are those that the request itself gives.
    """
    for name, value in locked.items():
        if name in ("f_x", "f_y") and value < LEAST_FOCAL_PX:
            raise Problem(
                422,
                "locked_out_of_bounds",
                f"{name} is locked at {value:g}, and no camera has a focal length below {LEAST_FOCAL_PX:g} px.",
                "It is half the image's width over the tangent of half its angle of view, in pixels.",
                parameter=name,
            )
        if name in bounds:
            _check(name, value, bounds[name], "the request's own bounds", "")


def check_camera_locks(
    locked: Mapping[str, float],
    of_lens: Mapping[str, float],
    bounds: Mapping[str, Interval],
    camera: RigCamera,
    rig: Mapping[str, Interval],
    fit: Json,
) -> None:
    """Refuse what lies where this camera would not be looked for: 422 ``locked_out_of_bounds``.

    ``locked`` are the request's own values, ``of_lens`` those at which it holds the camera's stated lens.
    ``bounds`` are the request's, which go before ``rig``, the rig's of this camera, and these before the preset's;
    ``fit`` is the part of the solver's document that all fits share.
    """
    preset: BoundsPreset = fit["bounds_preset"]
    nominal_t = camera.nominal["translation_m"]
    size = (camera.image_width, camera.image_height)
    # Any angle about the nominal mount may be right where it looks straight ahead: it has several then.
    found = {
        name: interval
        for model in MODELS
        for name, interval in preset_bounds(
            preset, model, fit["search"], size, nominal_t, rotation_range_deg=fit["rotation_range_deg"]
        ).items()
    }
    for name, value in {**of_lens, **locked}.items():
        if name in bounds:
            continue
        whose = "the rig's bounds" if name in rig else f"the bounds of {preset}"
        hint = _OF_LENS if name in of_lens else ""
        _check(name, value, rig.get(name) or found[name], whose, f" of {camera.name}", hint)


def _check(name: str, value: float, interval: Interval, whose: str, of: str, hint: str = "") -> None:
    low, high = interval
    if low <= value <= high:
        return
    unit = " rad" if name in ANGLES else ""
    raise Problem(
        422,
        "locked_out_of_bounds",
        f"{name}{of} is locked at {value:g}{unit}, outside of [{low:g}, {high:g}]{unit}, {whose}.",
        hint.format(name)
        or f"Correct it; where it is right, give bounds of {name} that hold it, in the request or the rig.",
        parameter=name,
        bounds=[low, high],
    )
