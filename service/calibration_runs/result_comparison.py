"""Compares two results of one camera in degrees, millimetres, pixels and stated deviations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from service.calibration_runs.model_spread import MOUNT, difference
from service.calibration_runs.transforms import write
from service.db.base import Json

Floats = NDArray[np.float64]
# A chi-square of 1 to 6 degrees of freedom exceeds these once in a thousand times.
_ONCE_IN_A_THOUSAND: Final = (10.828, 13.816, 16.266, 18.467, 20.515, 22.458)


def compared(document: Json, other: Json, spread: Json | None, other_spread: Json | None) -> Json | None:
    """How far a result is from another one; None if the deviations of one of them are not known.

    ``spread`` holds their deviations with other models counted, if there are any. ``sigmas`` is the root mean square
    of the mount's difference over the deviations that both state. ``field_px`` is that of the pixels of the points
    that both see, ``field_sigmas`` the same over stated deviations. ``differs``: by more than chance does once in
    1000.
    """
    names = [name for name in MOUNT if _std(document, spread, name) and _std(other, other_spread, name)]
    if not names:
        return None
    apart = difference(document, other)
    C = _covariance(document, spread, names) + _covariance(other, other_spread, names)
    return {
        **_distances(apart),
        **_in_deviations(apart, names, C),
        **_field(document.get("field"), other.get("field")),
    }


def compared_with_stated(document: Json, spread: Json | None, R: Floats, t: Floats) -> Json:
    """How far a result's mount is from T_camera_lidar = (R, t), which is taken to be exact.

    ``sigmas`` and ``differs`` are as :func:`compared` says them; None if the result states no deviations.
    """
    apart = difference(document, {"transform": write("", "", R, t), "intrinsics": {}})
    names = [name for name in MOUNT if _std(document, spread, name)]
    found: Json = {**_distances(apart), "sigmas": None, "differs": None}
    return found | (_in_deviations(apart, names, _covariance(document, spread, names)) if names else {})


def _distances(apart: Mapping[str, float]) -> Json:
    return {
        "rotation_deg": float(np.linalg.norm([apart[name] for name in MOUNT[:3]])),
        "translation_mm": 1e3 * float(np.linalg.norm([apart[name] for name in MOUNT[3:]])),
    }


def _in_deviations(apart: Mapping[str, float], names: list[str], C: Floats) -> Json:
    d = np.array([apart[name] for name in names])
    chi2 = float(d @ np.linalg.solve(C, d))
    return {"sigmas": float(np.sqrt(chi2 / len(names))), "differs": chi2 > _ONCE_IN_A_THOUSAND[len(names) - 1]}


def _std(document: Json, spread: Json | None, name: str) -> float | None:
    return ((spread or document).get("std") or {}).get(name)


def _covariance(document: Json, spread: Json | None, names: list[str]) -> Floats:
    """Of the mount's parameters, people's units; with what other models add to the variances."""
    places = [document["covariance"]["names"].index(name) for name in names]
    C = np.array(document["covariance"]["matrix"], np.float64)[np.ix_(places, places)]
    whole = np.array([_std(document, spread, name) or 0.0 for name in names]) ** 2
    return C + np.diag(np.maximum(whole - np.diag(C), 0.0))


def _field(one: Json | None, other: Json | None) -> Json:
    """Older results do not have it."""
    none: Json = {"field_px": None, "field_sigmas": None}
    if not one or not other:
        return none
    _, here, there = np.intersect1d(one["number"], other["number"], return_indices=True)
    if not here.size:
        return none
    columns = {
        name: np.array(one[name], np.float64)[here] - np.array(other[name], np.float64)[there] for name in ("u", "v")
    }
    distance = np.hypot(columns["u"], columns["v"])
    sigma = np.hypot(np.array(one["sigma_px"], np.float64)[here], np.array(other["sigma_px"], np.float64)[there])
    return {
        "field_px": float(np.sqrt(np.mean(distance**2))),
        "field_sigmas": float(np.sqrt(np.mean(distance**2 / np.maximum(2.0 * sigma**2, 1e-12)))),
    }
