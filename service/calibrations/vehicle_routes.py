"""All that a vehicle is given, in one answer: what a car asks for when it starts."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from fastapi import APIRouter
from fastapi.encoders import jsonable_encoder
from fastapi.responses import Response

from apexcal.documents.base import Stored
from apexcal.documents.exports import VehicleCalibration
from service.auth.access import ReadAccess
from service.calibrations.asked import AskedOfVehicle
from service.calibrations.given_views import cameras_of, given_documents
from service.db.digests import content_hash
from service.db.fleets import Vehicle
from service.exports.answers import WantedFormat, exported
from service.exports.queries import of_given
from service.http.etags import Conditional, content_etag

router = APIRouter(tags=["calibrations"])


@router.get("/vehicles/{vehicle_id}/calibration", response_model=Stored[VehicleCalibration])
def read_vehicle_calibration(
    vehicle_id: UUID, access: ReadAccess, conditions: Conditional, wanted: WantedFormat, asked: AskedOfVehicle
) -> dict[str, Any] | Response:
    """What all cameras of a vehicle are given, read at one moment: ``cameras`` by name.

    ``without`` names the cameras that nothing was published for. ``camera`` narrows to some, and each of these must
    have a calibration. Where one of the asked cameras was withdrawn the whole answer is 410 `calibration_withdrawn`,
    where a sensor was swapped 409 `calibration_does_not_apply`. ``format``: all in another program's format.
    """
    vehicle = access.find(Vehicle, vehicle_id)
    if wanted is not None:
        return exported(wanted, of_given(access.session, vehicle, asked), conditions)
    found = given_documents(access.session, vehicle, asked)
    names = [] if asked.cameras else sorted(cameras_of(access.session, vehicle.id) - set(found))
    document = jsonable_encoder(
        {
            "vehicle_id": vehicle.id,
            "vehicle": vehicle.name,
            "alias": asked.alias,
            "as_of": asked.as_of,
            "cameras": found,
            "without": names,
        }
    )
    conditions.offer(content_etag(content_hash(document)))
    return document
