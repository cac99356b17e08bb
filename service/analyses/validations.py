"""Validations: a calibration tested on pairs or on a drive that it was not fitted to."""

from __future__ import annotations

from uuid import UUID

from apexcal.documents.pixel_points import PixelPointsRequest
from apexcal.documents.validations import (
    GivenCalibration,
    PairValidationRequest,
    RoadValidationRequest,
    ValidationRequest,
)
from service.calibrations.lenses import as_stated, take_over
from service.platform.auth.access import Access
from service.platform.db.analyses import Analysis
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration, CorrespondenceSet, Result, current_publication
from service.platform.db.recordings import Recording
from service.platform.http.problems import not_found, unprocessable
from service.recordings.queries import find_camera, ready_recording

# What a worker needs of a result; a document also has the errors of all its pairs.
_NEEDED = ("intrinsics", "transform", "covariance", "sigma_px", "model", "status")


def plan_on_pairs(access: Access, request: PairValidationRequest) -> Analysis:
    """Plan a validation on a set, of its vehicle and camera. Raises :class:`Problem` as :func:`_plan` does."""
    pairs = access.find(CorrespondenceSet, request.set_id, "engineer")
    row = _plan(access, request, pairs, pairs.camera)
    row.set_id = pairs.id
    return row


def plan_on_recording(access: Access, request: RoadValidationRequest | PixelPointsRequest) -> Analysis:
    """Plan an analysis with a calibration of a recording's camera.

    Raises :class:`Problem` as :func:`_plan` does, and 404 ``unknown_camera``.
    """
    recording = ready_recording(access, request.recording_id, "engineer")
    find_camera(access.session, recording.id, request.camera)
    row = _plan(access, request, recording, request.camera)
    row.recording_id = recording.id
    return row


def _plan(access: Access, request: ValidationRequest, data: Recording | CorrespondenceSet, camera: str) -> Analysis:
    """Plan a validation of the calibration that the request names, or of the camera's published one.

    Raises:
        Problem: 404 ``no_calibration``, 422 ``result_of_another_vehicle``, ``result_of_another_camera``, and as
            :func:`as_stated` and :func:`take_over` do.
    """
    row = Analysis(fleet_id=data.fleet_id, vehicle_id=data.vehicle_id)
    if request.calibration is not None:
        row.asked = {"camera": camera, "calibration": _stated(camera, request.calibration)}
        return row
    result = _published(access, data.vehicle_id, camera)
    if request.result_id is not None:
        result = access.find(Result, request.result_id, "engineer")
        _check_origin(access, result, data.vehicle_id, camera)
    if result is None:
        raise not_found(
            "no_calibration",
            f"The camera {camera!r} has no published calibration.",
            "Give `result_id`, or `calibration` with a lens and a transform.",
        )
    row.result_id = result.id
    row.asked = {"camera": camera, "calibration": {name: result.document[name] for name in _NEEDED}}
    return row


def _published(access: Access, vehicle_id: UUID, camera: str) -> Result | None:
    published = current_publication(access.session, vehicle_id, camera)
    return published and access.session.get(Result, published.result_id)


def _check_origin(access: Access, result: Result, vehicle_id: UUID, camera: str) -> None:
    if access.session.get_one(Calibration, result.calibration_id).vehicle_id != vehicle_id:
        raise unprocessable(
            "result_of_another_vehicle",
            "The result belongs to another vehicle than the data, and its sensors are mounted elsewhere.",
            "Name a result and data of one vehicle.",
        )
    if result.camera != camera:
        raise unprocessable(
            "result_of_another_camera",
            f"The result is of the camera {result.camera!r}, not of {camera!r}.",
            "Name a result and data of one camera.",
        )


def _stated(camera: str, calibration: GivenCalibration) -> Json:
    lens = as_stated(camera, calibration.lens.model_dump())
    parameters = take_over(camera, lens, [lens["model"]], "locked").parameters or {}
    intrinsics = {**parameters, "image_size": [lens["width"], lens["height"]]}
    return {"intrinsics": intrinsics, "transform": calibration.transform.model_dump(mode="json")}
