"""Whether the calibrations of one rig's cameras agree: with each other, and with what the rig states."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import sqrt
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.results import FitResult
from apexcal.geometry.se3 import SE3, from_document, to_document
from workers.geometry.models import parse_model
from workers.solver.camera_transform import Deviation, between_cameras, deviation, mount_covariance
from workers.solver.problem import FitProblem
from workers.solver.shared_vertices import Agreement, View, agreement, shared_rows, vertex_keys

Floats = NDArray[np.float64]
# A nominal mount is a rough figure, asked for within 30 degrees and searched within 1 m: those are three sigmas. What
# is further off is another camera.
NOMINAL_STD_DEG: Final = 10.0
NOMINAL_STD_M: Final = 0.33
# Deviations that noise alone gives once in some 16,000 comparisons are an alarm.
ALARM_SIGMAS: Final = 4.0
# Marks of one vertex that lie further apart than the noise of both cameras explains.
_FAR: Final = 1.5
_LISTED: Final = 10
_AXES: Final = ("rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z")


@dataclass(frozen=True, eq=False)
class StatedTransform:
    """T_cameraA_cameraB as the rig states it, with the standard deviation of each axis."""

    transform: SE3
    source: Literal["nominal", "rig"]
    std_deg: float = NOMINAL_STD_DEG
    std_m: float = NOMINAL_STD_M


@dataclass(frozen=True, eq=False)
class SolvedCamera:
    """A camera's recommended result: the problem that was fitted, its result, and the pairs.

    pairs: the correspondence set's columns, row by row those of the problem; detection: what their vertices come
    from, where that is one detection.
    """

    name: str
    problem: FitProblem
    result: FitResult
    pairs: Mapping[str, Sequence[Any]]
    detection: str | None = None

    @property
    def transform(self) -> SE3:
        """T_camera_lidar."""
        return from_document(self.result.transform.model_dump())

    @property
    def view(self) -> View:
        """What the comparison of marks needs."""
        outliers = np.zeros(len(self.problem.points), dtype=np.bool_)
        outliers[[outlier.index for outlier in self.result.outliers]] = True
        return View(
            parse_model(self.result.model),
            self.result.intrinsics.by_name(),
            self.transform,
            self.problem.points,
            self.problem.pixels,
            _noise_px(self.result),
            outliers,
        )


def rig_consistency(cameras: Sequence[SolvedCamera], stated: Sequence[StatedTransform]) -> dict[str, Any]:
    """Every two cameras compared, as plain JSON: {"pairs": [...], "alarms": [sentence, ...]}.

    Each pair has `cameras` and `models` [a, b], `transform` (T_a_b as a document) with `std` and
    `interval95_half_width` (small turns about camera a's axes in degrees, t in millimetres), or null where one of
    the mounts is not determined; `stated`, the deviation from each transform that the rig states; `shared`, how the
    marks of the vertices that both saw agree, or null; `sentences`, and those of them that are `alarms`.
    stated: nominal ones, and those known otherwise, by their frames. Raises GeometryError.
    """
    pairs = [_compare(a, b, stated) for a, b in combinations(cameras, 2)]
    return {"pairs": pairs, "alarms": [alarm for pair in pairs for alarm in pair["alarms"]]}


def _compare(a: SolvedCamera, b: SolvedCamera, stated: Sequence[StatedTransform]) -> dict[str, Any]:
    a.problem.stop.check()
    name = f"T_{a.name}_{b.name}"
    said = _Said([], [])
    transform = _between(a, b, name, stated, said)
    shared = _shared(a, b, said)
    models = [a.problem.model, b.problem.model]
    pair = {"cameras": [a.name, b.name], "models": models, "name": name, **transform, "shared": shared}
    return pair | {"sentences": said.sentences, "alarms": said.alarms}


@dataclass(frozen=True)
class _Said:
    sentences: list[str]
    alarms: list[str]

    def say(self, sentence: str, alarming: bool = False) -> None:
        (self.alarms if alarming else self.sentences).append(sentence)


def _between(
    a: SolvedCamera, b: SolvedCamera, name: str, stated: Sequence[StatedTransform], said: _Said
) -> dict[str, Any]:
    covariance_a, covariance_b = (mount_covariance(one.problem, one.result) for one in (a, b))
    if covariance_a is None or covariance_b is None:
        unknown = a.name if covariance_a is None else b.name
        said.say(f"{name} is not stated: the pairs do not determine the mount of {unknown}.")
        return {"transform": None, "std": None, "interval95_half_width": None, "stated": []}
    transform, covariance = between_cameras(a.transform, covariance_a, b.transform, covariance_b)
    deviations: list[dict[str, Any]] = []
    for one in _of_these_frames(stated, transform):
        against = deviation(transform, covariance, one.transform, _stated_covariance(one))
        deviations.append(_deviation_document(one, against))
        said.say(_deviation_sentence(name, one, against), against.sigmas > ALARM_SIGMAS)
    return _transform_document(transform, covariance) | {"stated": deviations}


def _transform_document(transform: SE3, covariance: Floats) -> dict[str, Any]:
    units = np.repeat([np.degrees(1.0), 1e3], 3)
    std = np.sqrt(np.diag(covariance)) * units
    keys = [f"{axis}_{'deg' if place < 3 else 'mm'}" for place, axis in enumerate(_AXES)]
    return {
        "transform": to_document(transform),
        "std": dict(zip(keys, std.tolist(), strict=True)),
        "interval95_half_width": dict(zip(keys, (1.959963984540054 * std).tolist(), strict=True)),
    }


def _of_these_frames(stated: Sequence[StatedTransform], found: SE3) -> list[StatedTransform]:
    wanted = (found.to_frame, found.from_frame)
    result: list[StatedTransform] = []
    for one in stated:
        turned = (one.transform.from_frame, one.transform.to_frame) == wanted
        transform = one.transform.inverse() if turned else one.transform
        if (transform.to_frame, transform.from_frame) == wanted:
            result.append(replace(one, transform=transform))
    return result


def _stated_covariance(one: StatedTransform) -> Floats:
    return np.diag(np.repeat([np.radians(one.std_deg) ** 2, one.std_m**2], 3))


def _deviation_document(one: StatedTransform, against: Deviation) -> dict[str, Any]:
    return {
        "source": one.source,
        "std_deg": one.std_deg,
        "std_mm": 1e3 * one.std_m,
        "rotation_deg": against.rotation_deg,
        "translation_mm": against.translation_mm,
        "chi2": against.chi2,
        "degrees_of_freedom": against.freedom,
        "probability": against.probability,
        "sigmas": against.sigmas,
    }


def _deviation_sentence(name: str, one: StatedTransform, against: Deviation) -> str:
    what = "the nominal mount" if one.source == "nominal" else "what the rig states"
    good_to = f"taken as good to {one.std_deg:g} degrees and {1e3 * one.std_m:g} mm about and along each axis"
    far = f"{name} lies {against.rotation_deg:.2f} degrees and {against.translation_mm:.0f} mm from {what}"
    # All six axes count together, so a distance of more than one axis' standard deviation may be an ordinary one.
    sigmas = "less than 1 sigma" if against.sigmas < 1.0 else f"{against.sigmas:.1f} sigmas"
    if against.sigmas <= ALARM_SIGMAS:
        return f"{far}. That agrees: it is {good_to}, one sigma; over all axes together this is {sigmas}."
    return f"{far}, {sigmas} where it is {good_to}: noise does not explain it."


def _vertices(count: int) -> str:
    return "1 vertex was" if count == 1 else f"{count} vertices were"


def _shared(a: SolvedCamera, b: SolvedCamera, said: _Said) -> dict[str, Any] | None:
    one_detection = a.detection is not None and a.detection == b.detection
    rows = shared_rows(vertex_keys(a.pairs, one_detection), vertex_keys(b.pairs, one_detection))
    both = f"{a.name} and {b.name}"
    if len(rows) == 0:
        said.say(f"No vertex was marked in both {both}.")
        return None
    found = agreement(a.view, b.view, rows)
    if found is None:
        said.say(f"{_vertices(len(rows))} marked in both {both} and cannot be compared.")
        return None
    beyond_noise = found.rms_px > _FAR * found.expected_rms_px or found.offset_sigmas > ALARM_SIGMAS
    du, dv = found.offset_px
    parts = [
        f"{_vertices(found.counted)} marked in both {both}: where {a.name}'s marks put them, {b.name}'s marks lie "
        f"{found.rms_px:.2f} px away (RMS; noise explains {found.expected_rms_px:.2f}), on average by "
        f"({du:+.2f}, {dv:+.2f}) px, {found.offset_sigmas:.1f} sigmas."
    ]
    if beyond_noise:
        parts.append("That is more than noise: a clock, marks of another corner, or a lens model that does not fit.")
    if len(found.odd):
        parts.append(f"{len(found.odd)} {'stands' if len(found.odd) == 1 else 'stand'} out.")
    said.say(" ".join(parts), beyond_noise)
    return _agreement_document(found, a.pairs, len(rows))


def _agreement_document(found: Agreement, pairs: Mapping[str, Sequence[Any]], vertices: int) -> dict[str, Any]:
    stamps = pairs.get("stamp_ns")
    return {
        "vertices": vertices,
        "counted": found.counted,
        "mean_px": found.mean_px,
        "rms_px": found.rms_px,
        "expected_rms_px": found.expected_rms_px,
        "offset_px": list(found.offset_px),
        "offset_sigmas": found.offset_sigmas,
        "odd": [
            {
                "indices": found.rows[i].tolist(),
                "stamp_ns": None if stamps is None else stamps[int(found.rows[i, 0])],
                "distance_px": float(found.distances_px[i]),
                "sigmas": float(found.scores[i]),
            }
            for i in found.odd[:_LISTED].tolist()
        ],
    }


def _noise_px(result: FitResult) -> float:
    # rms^2 = mean |d|^2 over n pairs is sigma^2 (2 n - F) / n.
    n = result.kept.pairs
    return result.kept.rms_px * sqrt(n / max(2 * n - result.free_parameters, 1))
