"""The differences of two results of one camera, in degrees, millimetres, pixels and stated deviations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from apexcal.documents.comparisons import FieldDifference, ParameterDifference, ResultDifference
from apexcal.documents.precision import FIELD_AZIMUTHS_DEG, FIELD_ELEVATIONS_DEG, FIELD_RANGES_M, Field
from apexcal.documents.results import ComparedResult, FitResult, Intrinsics
from apexcal.geometry.rotations import vector_from_rotation
from apexcal.geometry.se3 import SE3, Floats, from_document

# Any result as it is compared.
Compared = FitResult | ComparedResult
TURNS: Final = ("rotation_x", "rotation_y", "rotation_z")
MOUNT: Final = (*TURNS, "t_x", "t_y", "t_z")
# What the parameters of all models mean alike.
_LENS: Final = ("f_x", "f_y", "c_x", "c_y")
# A chi-square of 1 to 6 degrees of freedom exceeds these once in a thousand times.
_ONCE_IN_A_THOUSAND: Final = (10.828, 13.816, 16.266, 18.467, 20.515, 22.458)


def compared(result: Compared, other: Compared) -> ResultDifference | None:
    """Return how far a published result is from another one; None if the deviations of one are not known.

    ``sigmas`` is the root mean square
    of the mount's difference over the deviations that both state. ``field_px`` is that of the pixels of the points
    that both see, ``field_sigmas`` the same over stated deviations. ``differs``: by more than chance does once in
    1000.
    """
    names = [name for name in MOUNT if result.std.get(name) and other.std.get(name)]
    if not names:
        return None
    apart = difference(result, other)
    C = _covariance(result, names) + _covariance(other, names)
    sizes = _distances(apart) | _in_deviations(apart, names, C) | _field_sizes(_shared_points(result, other))
    return ResultDifference(**sizes, incomparable=None)


def compared_with_stated(result: Compared, stated: SE3) -> dict[str, Any]:
    """Return how far a result's mount is from a stated T_camera_lidar, which is taken to be exact.

    ``sigmas`` and ``differs`` are as :func:`compared` says them; None if the result states no deviations.
    """
    apart = _mounts_apart(from_document(result.transform), stated)
    names = [name for name in MOUNT if result.std.get(name)]
    sigmas = _in_deviations(apart, names, _covariance(result, names)) if names else {}
    return _distances(apart) | {"sigmas": None, "differs": None} | sigmas


def side_by_side(result: Compared, other: Compared) -> dict[str, Any]:
    """Return the measured members of a ``ResultComparison``, also where a result states no deviations."""
    apart, field = difference(result, other), _shared_points(result, other)
    stated = compared(result, other)
    return {
        **{name: _distances(apart)[name] for name in ("rotation_deg", "translation_mm")},
        **_field_sizes(field),
        "sigmas": stated and stated.sigmas,
        "differs": stated and stated.differs,
        "parameters": [
            _parameter(name, value, result.std.get(name), other.std.get(name))
            for name, value in (apart | _distortion(result.intrinsics, other.intrinsics)).items()
        ],
        "field": field,
    }


def difference(result: Compared, other: Compared) -> dict[str, float]:
    """Return the difference of two results by parameter: turns about the camera's axes (degrees), metres, pixels."""
    apart = _mounts_apart(from_document(result.transform), from_document(other.transform))
    return apart | {name: getattr(result.intrinsics, name) - getattr(other.intrinsics, name) for name in _LENS}


def _mounts_apart(mount: SE3, other: SE3) -> dict[str, float]:
    turn_deg = np.degrees(vector_from_rotation(mount.R @ other.R.T))
    return dict(zip(MOUNT, [*turn_deg.tolist(), *(mount.t - other.t).tolist()], strict=True))


def _distances(apart: Mapping[str, float]) -> dict[str, Any]:
    turn, shift = [apart[name] for name in MOUNT[:3]], [1e3 * apart[name] for name in MOUNT[3:]]
    return {
        "rotation_deg": float(np.linalg.norm(turn)),
        "translation_mm": float(np.linalg.norm(shift)),
        "turn_deg": turn,
        "shift_mm": shift,
    }


def _in_deviations(apart: Mapping[str, float], names: list[str], C: Floats) -> dict[str, Any]:
    d = np.array([apart[name] for name in names])
    chi2 = float(d @ np.linalg.solve(C, d))
    return {"sigmas": float(np.sqrt(chi2 / len(names))), "differs": chi2 > _ONCE_IN_A_THOUSAND[len(names) - 1]}


def _covariance(result: Compared, names: list[str]) -> Floats:
    """Return the covariance of the mount's parameters, in people's units, with the spread between models."""
    rows = [result.covariance.names.index(name) for name in names]
    C = np.array(result.covariance.matrix, np.float64)[np.ix_(rows, rows)]
    whole = np.array([result.std[name] or 0.0 for name in names]) ** 2
    return C + np.diag(np.maximum(whole - np.diag(C), 0.0))


def _parameter(name: str, apart: float, own: float | None, other: float | None) -> ParameterDifference:
    # Millimetres of metres; all others are stated as their deviations are.
    scale = 1e3 if name in MOUNT[3:] else 1.0
    std = float(np.hypot(own, other)) if own and other else None
    return ParameterDifference(
        name=name,
        unit="mm" if name in MOUNT[3:] else "deg" if name in TURNS else "px" if name in _LENS else "",
        difference=scale * apart,
        std=std and scale * std,
        sigmas=std and abs(apart) / std,
    )


def _distortion(lens: Intrinsics, other: Intrinsics) -> dict[str, float]:
    """Return differences by coefficient; none for two models, whose coefficients mean different things."""
    if lens.model != other.model:
        return {}
    own, their = lens.by_name(), other.by_name()
    return {name: own[name] - their[name] for name in own if name not in _LENS and name in their}


def _shared_points(result: Compared, other: Compared) -> FieldDifference | None:
    """Where both results project the points of the field that both see; a fit without a fold has no field."""
    if result.field is None or other.field is None:
        return None
    number, here, there = np.intersect1d(result.field.number, other.field.number, return_indices=True)
    if not here.size:
        return None
    own, their = _columns(result.field)[:, here], _columns(other.field)[:, there]
    ranges = np.array(FIELD_RANGES_M)[number // (len(FIELD_ELEVATIONS_DEG) * len(FIELD_AZIMUTHS_DEG))]
    return FieldDifference(
        distance_m=ranges.tolist(),
        u=own[0].tolist(),
        v=own[1].tolist(),
        du=(own[0] - their[0]).tolist(),
        dv=(own[1] - their[1]).tolist(),
        sigma_px=np.hypot(own[2], their[2]).tolist(),
    )


def _columns(field: Field) -> Floats:
    return np.array([field.u, field.v, field.sigma_px], np.float64)


def _field_sizes(points: FieldDifference | None) -> dict[str, Any]:
    """Over the points that both see; null if there are none."""
    if points is None:
        return {"field_px": None, "field_sigmas": None}
    squares = np.square(points.du) + np.square(points.dv)
    variances = np.maximum(2.0 * np.square(points.sigma_px), 1e-12)
    return {
        "field_px": float(np.sqrt(np.mean(squares))),
        "field_sigmas": float(np.sqrt(np.mean(squares / variances))),
    }
