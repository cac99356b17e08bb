"""Whether what a calibration states holds, against the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.results import FitResult
from apexcal.documents.summaries import BetweenModels
from apexcal.geometry.rotations import rotation_from_vector, vector_from_rotation
from apexcal.geometry.se3 import SE3, from_document
from benchmarks.coverage.bounds import turn_bound
from benchmarks.coverage.calibrations import Calibration
from workers.geometry.models import INTRINSICS, parse_model
from workers.geometry.projection import project

Floats = NDArray[np.float64]
MOUNT: Final = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z")
# The whole difference between the lens that is chosen and the right one, px; and deviations of the mount, 99.5 %.
_NEAR_PX: Final = 0.5
_WITHIN: Final = 2.8
_STEP: Final = 1e-3
_EVERY: Final = 3  # of the marks; no multiple of a board's corners
_SHARED: Final = ("shared_errors", "halves")
"""The checks of errors that pairs share."""


@dataclass(frozen=True)
class Score:
    """One calibration: which intervals hold, of the mount and of pixels over the marked field, and what was reported.

    ``doubted``: whether a check says that pairs err together, or halves differ. ``bound``: see `turn_bound`.
    """

    held: dict[str, bool]
    pixels_held: float
    of_true_lens: float
    recommended: str | None
    right: bool
    status: str
    halves: float | None
    doubted: bool
    error_deg: float
    error_mm: float
    field_px: float
    bound: float | None = None

    @property
    def sound(self) -> bool:
        """Whether the result's status is `ok`."""
        return self.status == "ok"


def score(done: Calibration) -> Score:
    """The recommended result against the truth. Where none is recommended, nothing holds."""
    lens, name = done.paired.camera.model, done.summary.recommended
    bound = turn_bound(done) if done.errors.second_half_deg else None
    if name is None:
        return Score({}, 0.0, _share(_mount_held(done, lens)), None, False, "none", None, False, 0.0, 0.0, 0.0, bound)
    result = done.results[name]
    held = _mount_held(done, name)
    error = _mount_error(done, result)
    field_px, pixels_held = _field(done, name)
    near = name == lens or field_px - _field(done, lens)[0] <= _NEAR_PX
    std = _stated(done, name).std
    within = all(std[key] is None or abs(error[key]) <= _WITHIN * std[key] for key in MOUNT if key in std)
    return Score(
        held,
        pixels_held,
        _share(_mount_held(done, lens)),
        name,
        name == lens or (near and within),
        result.status,
        result.halves[0].ratio if result.halves else None,
        any(one.name in _SHARED and one.verdict != "pass" for one in result.checks),
        float(np.linalg.norm([error[key] for key in MOUNT[:3]])),
        1e3 * float(np.linalg.norm([error[key] for key in MOUNT[3:]])),
        field_px,
        bound,
    )


def _stated(done: Calibration, name: str) -> BetweenModels | FitResult:
    """What is published of a result's deviations."""
    return done.summary.models[name].between_models or done.results[name]


def _mount_error(done: Calibration, result: FitResult) -> dict[str, float]:
    found, truth = from_document(result.transform), done.paired.camera.T_camera_lidar
    turn = np.degrees(vector_from_rotation(found.R @ truth.R.T))
    return dict(zip(MOUNT, [*turn.tolist(), *(found.t - truth.t).tolist()], strict=True))


def _mount_held(done: Calibration, name: str) -> dict[str, bool]:
    error, half = _mount_error(done, done.results[name]), _stated(done, name).interval95_half_width
    return {key: half[key] is None or abs(error[key]) <= half[key] for key in MOUNT if key in half}


def _share(held: dict[str, bool]) -> float:
    return float(np.mean(list(held.values()))) if held else 0.0


def _field(done: Calibration, name: str) -> tuple[float, float]:
    """Mean distance from the true projection over the marked field, px; the share of intervals there that hold."""
    points = done.paired.places(done.paired.taken_ns)[::_EVERY]
    truly = done.paired.camera.project(points)
    here = projected(done.results[name], points)
    result, spread = done.results[name], done.summary.models[name].between_models
    J = np.stack([derivative(result, key, points) for key in result.covariance.names], axis=2)
    variance = np.einsum("nij,jk,nik->ni", J, np.array(result.covariance.matrix), J)
    for other, share in spread.weights.items() if spread else ():
        if other != name:
            variance = variance + share * (projected(done.results[other], points) - here) ** 2
    factors = [
        half / std
        for key, half in result.interval95_half_width.items()
        if half is not None and (std := result.std[key])
    ]
    error = here - truly
    good = np.isfinite(error).all(axis=1)
    held = np.abs(error[good]) <= float(np.median(factors)) * np.sqrt(variance[good])
    return float(np.mean(np.minimum(np.hypot(*error[good].T), 1e3))), float(held.mean())


def projected(result: FitResult, points: Floats) -> Floats:
    lens = result.intrinsics
    return project(parse_model(lens.model), lens.by_name(), from_document(result.transform).apply(points))[0]


def derivative(result: FitResult, key: str, points: Floats) -> Floats:
    """(N, 2) px by a person's unit of one parameter, by central differences."""
    step = _STEP * max(abs(result.std[key] or 1.0), 1e-9)
    return (_moved(result, key, step, points) - _moved(result, key, -step, points)) / (2.0 * step)


def _moved(result: FitResult, key: str, step: float, points: Floats) -> Floats:
    mount, lens, model = from_document(result.transform), result.intrinsics.by_name(), parse_model(result.model)
    if key in INTRINSICS[model]:
        lens[key] += step
    elif key.startswith("t_"):
        t = mount.t.copy()
        t[MOUNT.index(key) - 3] += step
        mount = SE3(mount.to_frame, mount.from_frame, mount.R, t)
    else:
        turn = np.zeros(3)
        turn[MOUNT.index(key)] = np.radians(step)
        mount = SE3(mount.to_frame, mount.from_frame, rotation_from_vector(turn) @ mount.R, mount.t)
    return project(model, lens, mount.apply(points))[0]
