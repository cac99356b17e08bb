"""How far a result is from another one of its camera."""

from __future__ import annotations

from typing import NamedTuple
from uuid import UUID

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.documents.comparisons import ResultComparison
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from service.platform.http.problems import not_found, unprocessable


class _Origin(NamedTuple):
    """What a result was fitted to."""

    vehicle_id: UUID
    set_id: UUID
    recording_id: UUID | None

    def shares_pairs(self, other: _Origin) -> bool:
        return self.set_id == other.set_id or (
            self.recording_id is not None and self.recording_id == other.recording_id
        )


def comparison_of(session: Session, result: Result, other: Result) -> ResultComparison:
    """Raises :class:`Problem` 422 ``result_of_another_camera``: sensors of two places cannot be compared."""
    # Imported here: it needs NumPy, which takes a twentieth of the service's start.
    from apexcal.geometry.result_differences import side_by_side

    own, their = _origin(session, result), _origin(session, other)
    if (own.vehicle_id, result.camera) != (their.vehicle_id, other.camera):
        raise unprocessable(
            "result_of_another_camera",
            "The two results belong to different cameras or vehicles, so their mounts differ.",
            "Compare two results of one camera of one vehicle.",
        )
    difference = side_by_side(result.fit, other.fit, result.spread, other.spread)
    shares_pairs = own.shares_pairs(their)
    width, height = result.fit.intrinsics.image_size
    return ResultComparison(
        result_id=result.id,
        other_id=other.id,
        vehicle_id=own.vehicle_id,
        camera=result.camera,
        model=result.model,
        other_model=other.model,
        sentence=_sentence(result.camera, difference, shares_pairs=shares_pairs),
        shares_pairs=shares_pairs,
        image_size=(width, height),
        **difference,
    )


def _origin(session: Session, result: Result) -> _Origin:
    row = session.execute(
        select(Calibration.vehicle_id, CorrespondenceSet.id, CorrespondenceSet.recording_id)
        .select_from(CalibrationRun)
        .join(Calibration, Calibration.id == CalibrationRun.calibration_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(CalibrationRun.id == result.run_id)
    ).one_or_none()
    if row is None:
        # Deleted at this moment.
        raise not_found()
    return _Origin(*row)


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
            " Both were fitted to the same pairs or to pairs of one recording. They share errors, so the difference "
            "is more standard deviations than that."
        )
    return sentence
