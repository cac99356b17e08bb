"""Bounds of the search: the presets, resolved to numbers for each parameter."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, radians
from typing import Final, Literal

from apexcal.documents.camera_models import ModelName, SearchForm, parameter_names

BoundsPreset = Literal["image-size", "paper-table-1"]
DEFAULT_ROTATION_RANGE_DEG: Final = 30.0
# No camera has a shorter focal length, and a division by a tiny one may overflow.
LEAST_FOCAL_PX: Final = 1.0

Interval = tuple[float, float]
SKEW_BOUNDS: Final[Interval] = (-0.1, 0.1)

_TABLE_1: Final[dict[str, Interval]] = {
    "alpha": (0.2 * pi, 0.8 * pi),
    "beta": (-0.8 * pi, -0.2 * pi),
    "gamma": (-0.3 * pi, 0.3 * pi),
    **dict.fromkeys(("t_x", "t_y", "t_z"), (-1.0, 1.0)),
    **dict.fromkeys(("f_x", "f_y", "c_x", "c_y"), (300.0, 900.0)),
}
_RADIAL: Final = tuple(f"k{order}" for order in range(1, 7))
_LENS: Final[dict[str, Interval]] = {"skew": SKEW_BOUNDS, **dict.fromkeys((*_RADIAL, "p1", "p2"), (-1.0, 1.0))}
# Factory calibrations of OAK-D W and Azure Kinect cameras have coefficients up to 5.4.
_QUOTIENT: Final[Interval] = (-10.0, 10.0)


def preset_bounds(
    preset: BoundsPreset,
    model: ModelName,
    form: SearchForm,
    image_size: tuple[int, int],
    nominal_t: Sequence[float],
    nominal_angles: Sequence[float] | None = None,
    reach: float = radians(DEFAULT_ROTATION_RANGE_DEG),
) -> dict[str, Interval]:
    """(lower, upper) of every parameter of the model, in radians, metres and pixels.

    ``image-size`` follows from image_size (width, height) in pixels and from the nominal T_camera_lidar: its
    translation in metres, and its Euler angles zyx in radians (None: any angle). ``paper-table-1`` is Table I of the
    paper. The angles of the ``rotation_vector`` form are +-reach (radians) in both; those of the ``euler`` form
    are Table I's, or +-reach about the nominal's angles.
    """
    bounds = _LENS | (dict.fromkeys(_RADIAL, _QUOTIENT) if model == "rational_polynomial" else {})
    bounds |= dict.fromkeys(("rotation_x", "rotation_y", "rotation_z"), (-reach, reach))
    if preset == "paper-table-1":
        bounds |= _TABLE_1
    else:
        width, height = image_size
        bounds |= {name: (at - 1.0, at + 1.0) for name, at in zip(("t_x", "t_y", "t_z"), nominal_t, strict=True)}
        bounds |= dict.fromkeys(("f_x", "f_y"), (0.2 * width, 3.0 * width))
        bounds |= {"c_x": (0.0, width - 1.0), "c_y": (0.0, height - 1.0)}
        about = [(-pi, pi)] * 3 if nominal_angles is None else [(a - reach, a + reach) for a in nominal_angles]
        bounds |= dict(zip(("alpha", "beta", "gamma"), about, strict=True))
    return {name: bounds[name] for name in parameter_names(model, form)}
