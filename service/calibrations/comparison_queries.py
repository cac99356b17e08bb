"""How far a result is from another one of its camera."""

from __future__ import annotations

from sqlalchemy.orm import Session

from apexcal.documents.comparisons import ResultComparison
from service.calibrations.views import origin_of
from service.platform.db.base import Json
from service.platform.db.calibrations import Result
from service.platform.http.problems import unprocessable


def comparison_of(session: Session, result: Result, other: Result) -> ResultComparison:
    """Raises :class:`Problem` 422 ``result_of_another_camera``: sensors of two places cannot be compared."""
    # Imported here: it needs NumPy, which takes a twentieth of the service's start.
    from apexcal.geometry.result_differences import side_by_side

    _, calibration, pairs = origin_of(session, result)
    _, other_calibration, other_pairs = origin_of(session, other)
    if (calibration.vehicle_id, result.camera) != (other_calibration.vehicle_id, other.camera):
        raise unprocessable(
            "result_of_another_camera",
            "The two results belong to different cameras or vehicles, so their mounts differ.",
            "Compare two results of one camera of one vehicle.",
        )
    difference = side_by_side(result.published, other.published)
    shares_pairs = pairs.id == other_pairs.id or (
        pairs.recording_id is not None and pairs.recording_id == other_pairs.recording_id
    )
    width, height = result.published.intrinsics.image_size
    return ResultComparison(
        result_id=result.id,
        other_id=other.id,
        vehicle_id=calibration.vehicle_id,
        camera=result.camera,
        model=result.model,
        other_model=other.model,
        sentence=_sentence(result.camera, difference, shares_pairs=shares_pairs),
        shares_pairs=shares_pairs,
        image_size=(width, height),
        **difference,
    )


def _sentence(camera: str, apart: Json, *, shares_pairs: bool) -> str:
    sentence = (
        f"The mounts of {camera} differ by {apart['rotation_deg']:.3f} degrees and {apart['translation_mm']:.1f} mm"
    )
    if apart["sigmas"] is None:
        return f"{sentence}. One of the results states no standard deviations, so this cannot be judged."
    sentence += f", {apart['sigmas']:.1f} standard deviations of what both state: "
    sentence += "more than chance." if apart["differs"] else "chance explains it."
    if shares_pairs:
        sentence += (
            " Both share errors, as of the same pairs or one recording, so the difference means more than that."
        )
    return sentence
