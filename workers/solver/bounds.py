"""Where the search may look: the presets of bounds, resolved to numbers for each parameter."""

from collections.abc import Mapping
from math import pi
from typing import Final, Literal, get_args

import numpy as np

from workers.geometry.models import ModelName, SearchForm, parameter_names
from workers.geometry.rotations import euler_from_rotation
from workers.geometry.transforms import RigidTransform
from workers.solver.errors import SolveError

BoundsPreset = Literal["image-size", "paper-table-1"]
BOUNDS_PRESETS: Final[tuple[BoundsPreset, ...]] = get_args(BoundsPreset)
DEFAULT_ROTATION_RANGE_DEG: Final = 30.0

Interval = tuple[float, float]

_TABLE_1_ANGLES: Final[dict[str, Interval]] = {
    "alpha": (0.2 * pi, 0.8 * pi),
    "beta": (-0.8 * pi, -0.2 * pi),
    "gamma": (-0.3 * pi, 0.3 * pi),
}


def parse_bounds_preset(name: object) -> BoundsPreset:
    """The preset of that name. Raises SolveError `unknown_bounds_preset`."""
    for preset in BOUNDS_PRESETS:
        if name == preset:
            return preset
    raise SolveError(
        "unknown_bounds_preset",
        f"There is no preset of bounds named {name!r}.",
        f"The presets are {', '.join(BOUNDS_PRESETS)}; single parameters are narrowed with `bounds`.",
    )


def preset_bounds(
    preset: BoundsPreset,
    model: ModelName,
    form: SearchForm,
    image_size: tuple[int, int],
    nominal: RigidTransform,
    rotation_range_deg: float = DEFAULT_ROTATION_RANGE_DEG,
) -> dict[str, Interval]:
    """(lower, upper) of every parameter of the model, in radians, metres and pixels.

    `image-size` follows from image_size (width, height) in pixels and from the nominal T_camera_lidar;
    `paper-table-1` is Table I of the paper. The angles of the `rotation_vector` form are +-rotation_range_deg in
    both; those of the `euler` form are Table I's, or +-rotation_range_deg about the nominal's angles.
    """
    bounds = _rotation_bounds(preset, form, nominal, rotation_range_deg)
    if preset == "paper-table-1":
        bounds |= dict.fromkeys(("t_x", "t_y", "t_z"), (-1.0, 1.0))
        bounds |= dict.fromkeys(("f_x", "f_y", "c_x", "c_y"), (300.0, 900.0))
    else:
        width, height = image_size
        for axis, centre in zip(("t_x", "t_y", "t_z"), nominal.t.tolist(), strict=True):
            bounds[axis] = (centre - 1.0, centre + 1.0)
        bounds |= dict.fromkeys(("f_x", "f_y"), (0.2 * width, 3.0 * width))
        bounds |= {"c_x": (0.0, width - 1.0), "c_y": (0.0, height - 1.0)}
    bounds["skew"] = (-0.1, 0.1)
    bounds |= {f"k{order}": (-1.0, 1.0) for order in range(1, 6)}
    return {name: bounds[name] for name in parameter_names(model, form)}


def _rotation_bounds(
    preset: BoundsPreset, form: SearchForm, nominal: RigidTransform, rotation_range_deg: float
) -> dict[str, Interval]:
    if not 0.0 < rotation_range_deg <= 180.0:
        raise SolveError(
            "bounds_inside_out",
            f"rotation_range_deg is {rotation_range_deg}; it must be above 0 and at most 180 degrees.",
            "30 suits a mount that is roughly known, 180 any mount at all.",
        )
    reach = float(np.radians(rotation_range_deg))
    if form == "rotation_vector":
        return dict.fromkeys(("rotation_x", "rotation_y", "rotation_z"), (-reach, reach))
    if preset == "paper-table-1":
        return dict(_TABLE_1_ANGLES)
    angles = euler_from_rotation(nominal.R).tolist()
    return {name: (a - reach, a + reach) for name, a in zip(("alpha", "beta", "gamma"), angles, strict=True)}


def narrowed(bounds: Mapping[str, Interval], overrides: Mapping[str, Interval]) -> dict[str, Interval]:
    """The bounds with single parameters replaced. Raises SolveError for unknown names and lower > upper."""
    check_names(overrides, bounds, "bounds")
    merged = dict(bounds) | {name: (float(lo), float(hi)) for name, (lo, hi) in overrides.items()}
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


def check_names(given: Mapping[str, object], known: Mapping[str, object], where: str) -> None:
    """Raises SolveError `unknown_parameter` for a name that the model and search form do not have."""
    for name in given:
        if name not in known:
            raise SolveError(
                "unknown_parameter",
                f"`{where}` names {name!r}, which is no parameter of this model in this search form.",
                f"The parameters are {', '.join(known)}.",
            )
