"""Locked values held against the bounds in which the search would look for them.

The presets are those of ``workers/solver/bounds.py``, which the service may not import; a contract test compares
both.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, radians

from service.calibrations.model_names import ANGLES, BoundsPreset, SearchForm
from service.db.base import Json
from service.db.fleets import RigCamera
from service.http.problems import Problem

Interval = tuple[float, float]

# Less is no focal length of a camera, and what is divided by it may be infinite.
LEAST_FOCAL_PX = 1.0
_LENS: dict[str, Interval] = {"skew": (-0.1, 0.1), **{f"k{order}": (-1.0, 1.0) for order in range(1, 6)}}
_TABLE_1: dict[str, Interval] = {
    "alpha": (0.2 * pi, 0.8 * pi),
    "beta": (-0.8 * pi, -0.2 * pi),
    "gamma": (-0.3 * pi, 0.3 * pi),
    **dict.fromkeys(("t_x", "t_y", "t_z"), (-1.0, 1.0)),
    **dict.fromkeys(("f_x", "f_y", "c_x", "c_y"), (300.0, 900.0)),
}
# About the nominal mount's angles, which are several where it looks straight ahead: any angle may be right.
_ANY_ANGLES: dict[str, Interval] = dict.fromkeys(("alpha", "beta", "gamma"), (-pi, pi))

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
    found = preset_bounds(preset, fit["search"], camera, fit["rotation_range_deg"])
    for name, value in {**of_lens, **locked}.items():
        if name in bounds:
            continue
        whose = "the rig's bounds" if name in rig else f"the bounds of {preset}"
        hint = _OF_LENS if name in of_lens else ""
        _check(name, value, rig.get(name) or found[name], whose, f" of {camera.name}", hint)


def preset_bounds(
    preset: BoundsPreset, search: SearchForm, camera: RigCamera, rotation_range_deg: float
) -> dict[str, Interval]:
    """(lower, upper) of every parameter of any model in this form, in radians, metres and pixels."""
    reach = radians(rotation_range_deg)
    angles = dict.fromkeys(("rotation_x", "rotation_y", "rotation_z"), (-reach, reach))
    if preset == "paper-table-1":
        return _LENS | _TABLE_1 | angles
    width, height = camera.image_width, camera.image_height
    t = camera.nominal["translation_m"]
    return (
        _LENS
        | _ANY_ANGLES
        | angles
        | dict.fromkeys(("f_x", "f_y"), (0.2 * width, 3.0 * width))
        | {"c_x": (0.0, width - 1.0), "c_y": (0.0, height - 1.0)}
        | {name: (at - 1.0, at + 1.0) for name, at in zip(("t_x", "t_y", "t_z"), t, strict=True)}
    )


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
