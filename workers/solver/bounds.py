"""Where the search may look: the presets of bounds for a nominal mount, and single parameters replaced."""

from collections.abc import Mapping

import numpy as np

from apexcal.documents import bounds
from apexcal.documents.bounds import BOUNDS_PRESETS, DEFAULT_ROTATION_RANGE_DEG, BoundsPreset, Interval
from workers.geometry.models import ModelName, SearchForm
from workers.geometry.rotations import euler_from_rotation
from workers.geometry.transforms import RigidTransform
from workers.solver.errors import SolveError


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
    """(lower, upper) of every parameter of the model about a nominal T_camera_lidar; radians, metres and pixels.

    See `apexcal.documents.bounds.preset_bounds`. Raises SolveError `bounds_inside_out`.
    """
    if not 0.0 < rotation_range_deg <= 180.0:
        raise SolveError(
            "bounds_inside_out",
            f"rotation_range_deg is {rotation_range_deg}; it must be above 0 and at most 180 degrees.",
            "30 suits a mount that is roughly known, 180 any mount at all.",
        )
    angles = euler_from_rotation(nominal.R).tolist()
    return bounds.preset_bounds(preset, model, form, image_size, nominal.t.tolist(), angles, rotation_range_deg)


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


def check_names(given: Mapping[str, object], known: Mapping[str, object], where: str) -> None:
    """Raises SolveError `unknown_parameter` for a name that the model and search form do not have."""
    for name in given:
        if name not in known:
            raise SolveError(
                "unknown_parameter",
                f"`{where}` names {name!r}, which is no parameter of this model in this search form.",
                f"The parameters are {', '.join(known)}.",
            )
