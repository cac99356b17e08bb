"""Where the search may look: the presets of bounds for a nominal mount, and single parameters replaced."""

from collections.abc import Mapping

import numpy as np

from apexcal.documents import bounds
from apexcal.documents.bounds import BoundsPreset, Interval
from apexcal.geometry.rotations import euler_from_rotation
from apexcal.geometry.se3 import SE3
from workers.geometry.models import ModelName, SearchForm
from workers.solver.errors import SolveError


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


def check_names(given: Mapping[str, object], known: Mapping[str, object], where: str) -> None:
    """Raises SolveError `unknown_parameter` for a name that the model and search form do not have."""
    for name in given:
        if name not in known:
            raise SolveError(
                "unknown_parameter",
                f"`{where}` names {name!r}, which is no parameter of this model in this search form.",
                f"The parameters are {', '.join(known)}.",
            )
