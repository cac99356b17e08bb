"""Compares two results of one camera in degrees, millimetres, pixels and stated deviations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from apexcal.documents.results import FIELD_AZIMUTHS_DEG, FIELD_ELEVATIONS_DEG, FIELD_RANGES_M
from apexcal.geometry.rotations import vector_from_rotation
from apexcal.geometry.se3 import SE3, Floats, from_document, to_document
from service.platform.db.base import Json

_TURNS: Final = ("rotation_x", "rotation_y", "rotation_z")
_OFFSETS: Final = ("t_x", "t_y", "t_z")
MOUNT: Final = (*_TURNS, *_OFFSETS)
# What the parameters of all models mean alike.
_LENS: Final = ("f_x", "f_y", "c_x", "c_y")
# A chi-square of 1 to 6 degrees of freedom exceeds these once in a thousand times.
_ONCE_IN_A_THOUSAND: Final = (10.828, 13.816, 16.266, 18.467, 20.515, 22.458)
_COEFFICIENTS: Final = ("skew", "k1", "k2", "k3", "k4", "k5")


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


def compared_with_stated(document: Json, spread: Json | None, stated: SE3) -> Json:
    """How far a result's mount is from a stated T_camera_lidar, which is taken to be exact.

    ``sigmas`` and ``differs`` are as :func:`compared` says them; None if the result states no deviations.
    """
    apart = difference(document, {"transform": to_document(stated), "intrinsics": {}})
    names = [name for name in MOUNT if _std(document, spread, name)]
    found: Json = {**_distances(apart), "sigmas": None, "differs": None}
    return found | (_in_deviations(apart, names, _covariance(document, spread, names)) if names else {})


def difference(one: Json, other: Json) -> dict[str, float]:
    """By parameter, of two results' mounts and lenses: turns about the camera's axes in degrees, metres, pixels."""
    mount, other_mount = from_document(one["transform"]), from_document(other["transform"])
    apart = dict(zip(_TURNS, np.degrees(vector_from_rotation(mount.R @ other_mount.R.T)).tolist(), strict=True))
    apart |= dict(zip(_OFFSETS, (mount.t - other_mount.t).tolist(), strict=True))
    lens, other_lens = one["intrinsics"], other["intrinsics"]
    return apart | {name: lens[name] - other_lens[name] for name in _LENS if name in lens and name in other_lens}


def _distances(apart: Mapping[str, float]) -> Json:
    turn, shift = [apart[name] for name in MOUNT[:3]], [1e3 * apart[name] for name in MOUNT[3:]]
    return {
        "rotation_deg": float(np.linalg.norm(turn)),
        "translation_mm": float(np.linalg.norm(shift)),
        "turn_deg": turn,
        "shift_mm": shift,
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


def side_by_side(document: Json, other: Json, spread: Json | None, other_spread: Json | None) -> Json:
    """All members of a ``ResultComparison`` that are measured, also where a result states no deviations."""
    apart = difference(document, other)
    stated = compared(document, other, spread, other_spread) or {"sigmas": None, "differs": None}
    shared = _shared_points(document.get("field"), other.get("field"))
    return {
        **_distances(apart),
        **_field(document.get("field"), other.get("field")),
        **stated,
        "parameters": _parameters(apart | _distortion(document, other), (document, spread), (other, other_spread)),
        "field": shared and {name: values.tolist() for name, values in shared.items()},
    }


def _parameters(apart: Mapping[str, float], *sides: tuple[Json, Json | None]) -> list[Json]:
    found: list[Json] = []
    for name, value in apart.items():
        own, other = (_std(document, spread, name) for document, spread in sides)
        unit, scale = _unit(name)
        std = float(np.hypot(own, other)) if own and other else None
        found.append(
            {
                "name": name,
                "unit": unit,
                "difference": scale * value,
                "std": std and scale * std,
                "sigmas": std and abs(value) / std,
            }
        )
    return found


def _unit(name: str) -> tuple[str, float]:
    """In which a parameter's difference is stated, and how many make one of the unit of its deviations."""
    if name in MOUNT[3:]:
        return "mm", 1e3
    if name in MOUNT:
        return "deg", 1.0
    return ("px" if name in ("f_x", "f_y", "c_x", "c_y") else ""), 1.0


def _distortion(document: Json, other: Json) -> dict[str, float]:
    """By coefficient; of two models they mean different things."""
    one, two = document["intrinsics"], other["intrinsics"]
    if one["model"] != two["model"]:
        return {}
    return {name: one[name] - two[name] for name in _COEFFICIENTS if name in one and name in two}


def _shared_points(one: Json | None, other: Json | None) -> dict[str, Floats] | None:
    """The columns of a ``FieldDifference``; a fit without a fold of the pairs has no field."""
    if not one or not other:
        return None
    number, here, there = np.intersect1d(one["number"], other["number"], return_indices=True)
    if not here.size:
        return None
    own = {name: np.array(one[name], np.float64)[here] for name in ("u", "v", "sigma_px")}
    their = {name: np.array(other[name], np.float64)[there] for name in own}
    return {
        "distance_m": np.array(FIELD_RANGES_M)[number // (len(FIELD_ELEVATIONS_DEG) * len(FIELD_AZIMUTHS_DEG))],
        "u": own["u"],
        "v": own["v"],
        "du": own["u"] - their["u"],
        "dv": own["v"] - their["v"],
        "sigma_px": np.hypot(own["sigma_px"], their["sigma_px"]),
    }


def _field(one: Json | None, other: Json | None) -> Json:
    """Over the points that both see; null if there are none."""
    points = _shared_points(one, other)
    if points is None:
        return {"field_px": None, "field_sigmas": None}
    squares = points["du"] ** 2 + points["dv"] ** 2
    return {
        "field_px": float(np.sqrt(np.mean(squares))),
        "field_sigmas": float(np.sqrt(np.mean(squares / np.maximum(2.0 * points["sigma_px"] ** 2, 1e-12)))),
    }
