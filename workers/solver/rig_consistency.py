"""Whether the calibrations of one rig's cameras agree: with each other, and with what the rig states."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import sqrt
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.results import FitResult
from apexcal.documents.summaries import CameraPair, OddVertex, SharedVertices, StatedDeviation
from apexcal.documents.transforms import SolvedTransform
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
        return from_document(self.result.transform)

    @property
    def view(self) -> View:
        """Return the camera's view, which the comparison of marks needs."""
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


def rig_consistency(cameras: Sequence[SolvedCamera], stated: Sequence[StatedTransform]) -> list[CameraPair]:
    """Return every two cameras compared.

    `sentences` say what agrees, `alarms` what does not. stated: nominal transforms, and those known otherwise, by
    their frames. Raises GeometryError.
    """
    return [_compare(a, b, stated) for a, b in combinations(cameras, 2)]


def _compare(a: SolvedCamera, b: SolvedCamera, stated: Sequence[StatedTransform]) -> CameraPair:
    a.problem.stop.check()
    pair = CameraPair(
        cameras=[a.name, b.name],
        models=[a.problem.model, b.problem.model],
        name=f"T_{a.name}_{b.name}",
        transform=None,
        std=None,
        interval95_half_width=None,
        stated=[],
        shared=None,
        sentences=[],
        alarms=[],
    )
    covariances = [mount_covariance(camera.problem, camera.result) for camera in (a, b)]
    if covariances[0] is None or covariances[1] is None:
        unknown = a.name if covariances[0] is None else b.name
        pair.sentences.append(f"{pair.name} is not stated: the pairs do not determine the mount of {unknown}.")
    else:
        _state(pair, *between_cameras(a.transform, covariances[0], b.transform, covariances[1]), stated)
    pair.shared = _shared(a, b, pair)
    return pair


def _say(pair: CameraPair, sentence: str, *, is_alarm: bool) -> None:
    (pair.alarms if is_alarm else pair.sentences).append(sentence)


def _state(pair: CameraPair, transform: SE3, covariance: Floats, stated: Sequence[StatedTransform]) -> None:
    """Write T_a_b into the pair, its deviations, and how far it lies from what the rig states."""
    std = np.sqrt(np.diag(covariance)) * np.repeat([np.degrees(1.0), 1e3], 3)
    names = [f"{axis}_{'deg' if axis.startswith('rotation') else 'mm'}" for axis in _AXES]
    pair.transform = SolvedTransform.model_validate(to_document(transform))
    pair.std = dict(zip(names, std.tolist(), strict=True))
    pair.interval95_half_width = dict(zip(names, (1.959963984540054 * std).tolist(), strict=True))
    for known_transform in _of_these_frames(stated, transform):
        against = deviation(transform, covariance, known_transform.transform, _stated_covariance(known_transform))
        pair.stated.append(_deviation_document(known_transform, against))
        _say(pair, _deviation_sentence(pair.name, known_transform, against), is_alarm=against.sigmas > ALARM_SIGMAS)


def _of_these_frames(stated: Sequence[StatedTransform], T_a_b: SE3) -> list[StatedTransform]:
    frames = (T_a_b.to_frame, T_a_b.from_frame)
    result: list[StatedTransform] = []
    for candidate in stated:
        turned = (candidate.transform.from_frame, candidate.transform.to_frame) == frames
        transform = candidate.transform.inverse() if turned else candidate.transform
        if (transform.to_frame, transform.from_frame) == frames:
            result.append(replace(candidate, transform=transform))
    return result


def _stated_covariance(stated: StatedTransform) -> Floats:
    return np.diag(np.repeat([np.radians(stated.std_deg) ** 2, stated.std_m**2], 3))


def _deviation_document(stated: StatedTransform, against: Deviation) -> StatedDeviation:
    return StatedDeviation(
        source=stated.source,
        std_deg=stated.std_deg,
        std_mm=1e3 * stated.std_m,
        rotation_deg=against.rotation_deg,
        translation_mm=against.translation_mm,
        chi2=against.chi2,
        degrees_of_freedom=against.freedom,
        probability=against.probability,
        sigmas=against.sigmas,
    )


def _deviation_sentence(name: str, stated: StatedTransform, against: Deviation) -> str:
    what = "the nominal mount" if stated.source == "nominal" else "what the rig states"
    good_to = f"each axis is taken as good to {stated.std_deg:g} degrees and {1e3 * stated.std_m:g} mm"
    far = f"it lies {against.rotation_deg:.2f} degrees and {against.translation_mm:.0f} mm away"
    # All six axes count together, so a distance of more than one axis' standard deviation may be an ordinary one.
    sigmas = "less than 1 sigma" if against.sigmas < 1.0 else f"{against.sigmas:.1f} sigmas"
    if against.sigmas <= ALARM_SIGMAS:
        return f"{name} agrees with {what}: {far}, {sigmas} ({good_to}, one sigma)."
    return f"{name} disagrees with {what}: {far}, {sigmas} (limit {ALARM_SIGMAS:g}; {good_to}, one sigma)."


def _vertices(count: int) -> str:
    return "1 corner was" if count == 1 else f"{count} corners were"


def _shared(a: SolvedCamera, b: SolvedCamera, pair: CameraPair) -> SharedVertices | None:
    one_detection = a.detection is not None and a.detection == b.detection
    rows = shared_rows(vertex_keys(a.pairs, one_detection), vertex_keys(b.pairs, one_detection))
    both = f"{a.name} and {b.name}"
    if len(rows) == 0:
        pair.sentences.append(f"No corner was marked in both {both}.")
        return None
    shared = agreement(a.view, b.view, rows)
    if shared is None:
        pair.sentences.append(f"{_vertices(len(rows))} marked in both {both} and cannot be compared.")
        return None
    beyond_noise = shared.rms_px > _FAR * shared.expected_rms_px or shared.offset_sigmas > ALARM_SIGMAS
    du, dv = shared.offset_px
    parts = [
        f"{_vertices(shared.counted)} marked in both {both}. Marks of {b.name} lie {shared.rms_px:.2f} px (RMS; "
        f"noise explains {shared.expected_rms_px:.2f}) from where those of {a.name} put them, on average by "
        f"({du:+.2f}, {dv:+.2f}) px, {shared.offset_sigmas:.1f} sigmas."
    ]
    if beyond_noise:
        parts.append("That is more than noise: a clock, marks of another corner, or a lens model that does not fit.")
    if len(shared.odd):
        parts.append(f"{len(shared.odd)} {'stands' if len(shared.odd) == 1 else 'stand'} out.")
    _say(pair, " ".join(parts), is_alarm=beyond_noise)
    return _agreement_document(shared, a.pairs, len(rows))


def _agreement_document(shared: Agreement, pairs: Mapping[str, Sequence[Any]], vertices: int) -> SharedVertices:
    stamps = pairs.get("stamp_ns")
    return SharedVertices(
        vertices=vertices,
        counted=shared.counted,
        mean_px=shared.mean_px,
        rms_px=shared.rms_px,
        expected_rms_px=shared.expected_rms_px,
        offset_px=list(shared.offset_px),
        offset_sigmas=shared.offset_sigmas,
        odd=[
            OddVertex(
                indices=shared.rows[i].tolist(),
                stamp_ns=None if stamps is None else stamps[int(shared.rows[i, 0])],
                distance_px=float(shared.distances_px[i]),
                sigmas=float(shared.scores[i]),
            )
            for i in shared.odd[:_LISTED].tolist()
        ],
    )


def _noise_px(result: FitResult) -> float:
    # rms^2 = mean |d|^2 over n pairs is sigma^2 (2 n - F) / n.
    n = result.kept.pairs
    return result.kept.rms_px * sqrt(n / max(2 * n - result.free_parameters, 1))
