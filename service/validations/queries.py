"""Which calibration a validation is of, read when it is asked for."""

from __future__ import annotations

from typing import NamedTuple
from uuid import UUID

from apexcal.documents.validations import GivenCalibration, ValidationRequest
from service.platform.auth.access import Access
from service.platform.db.base import Json
from service.platform.db.calibrations import Calibration, Result
from service.platform.db.fleets import Vehicle
from service.platform.http.problems import Problem
from service.publications.queries import current_publication

# What a worker needs of a result; a document also has the errors of all its pairs.
_NEEDED = ("intrinsics", "transform", "covariance", "sigma_px", "model", "status")


class Validated(NamedTuple):
    """A calibration as it is now; ``result_id`` None where it was given with the request."""

    result_id: UUID | None
    document: Json


def validated(access: Access, vehicle: Vehicle, wanted: ValidationRequest) -> Validated:
    """The calibration that the request names, or what the camera is given now.

    Raises:
        Problem: 404 ``no_calibration``, 422 ``result_of_another_vehicle``, ``result_of_another_camera``.
    """
    if wanted.calibration is not None:
        return Validated(None, _given(wanted.calibration))
    if wanted.result_id is None:
        published = current_publication(access.session, vehicle.id, wanted.camera)
        result = published and access.session.get(Result, published.result_id)
        if result is None:
            raise Problem(
                404,
                "no_calibration",
                f"The camera {wanted.camera!r} has no published calibration.",
                "Give `result_id`, or `calibration` with a lens and a transform.",
            )
        return _of(result)
    result = access.find(Result, wanted.result_id, "engineer")
    of_vehicle = access.session.get_one(Calibration, result.calibration_id).vehicle_id
    if of_vehicle != vehicle.id:
        raise Problem(
            422,
            "result_of_another_vehicle",
            "The result belongs to another vehicle, whose sensors are mounted elsewhere.",
            "Ask for the validation at the vehicle of the result.",
        )
    if result.camera != wanted.camera:
        raise Problem(
            422,
            "result_of_another_camera",
            f"The result is of the camera {result.camera!r}, not of {wanted.camera!r}.",
            "Name the camera of the result.",
        )
    return _of(result)


def _of(result: Result) -> Validated:
    return Validated(result.id, {name: result.document[name] for name in _NEEDED})


def _given(calibration: GivenCalibration) -> Json:
    lens = calibration.lens
    intrinsics = {"model": lens.model, **lens.parameters, "image_size": list(lens.image_size)}
    return {"intrinsics": intrinsics, "transform": calibration.transform.model_dump(mode="json")}
