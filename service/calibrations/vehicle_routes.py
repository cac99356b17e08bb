"""All that a vehicle is given, in one answer: what a car asks for when it starts."""

from __future__ import annotations

from typing import Annotated, Any
from uuid import UUID

from fastapi import APIRouter, Query
from fastapi.encoders import jsonable_encoder
from fastapi.responses import Response
from pydantic import AwareDatetime
from sqlalchemy import select

from apexcal.documents.base import Sought, Stored
from apexcal.documents.exports import VehicleCalibration
from service.auth.access import ReadAccess
from service.calibrations.publication_views import vehicle_documents
from service.db.digests import content_hash
from service.db.fleets import Rig, RigCamera, Vehicle
from service.exports.answers import WantedFormat, exported
from service.exports.queries import of_results
from service.http.etags import Conditional, content_etag
from service.http.problems import Problem

router = APIRouter(tags=["calibrations"])


@router.get("/vehicles/{vehicle_id}/calibration", response_model=Stored[VehicleCalibration])
def read_vehicle_calibration(
    vehicle_id: UUID,
    access: ReadAccess,
    conditions: Conditional,
    wanted: WantedFormat,
    camera: Annotated[list[Sought] | None, Query(max_length=64)] = None,
    as_of: Annotated[AwareDatetime | None, Query()] = None,
) -> dict[str, Any] | Response:
    """What all cameras of a vehicle are given now, read at one moment: ``cameras`` by name.

    ``without`` names the cameras that nothing was published for. ``camera`` narrows to some, and each of these must
    have a calibration. ``as_of`` is a moment in the past. ``format``: all of them in another program's format.
    """
    vehicle = access.find(Vehicle, vehicle_id)
    asked = sorted(set(camera or []))
    found = vehicle_documents(access.session, vehicle.id, asked, as_of)
    missing = [name for name in asked if name not in found]
    if missing or not found:
        which = f"the camera {missing[0]!r}" if missing else "any camera"
        when = f" until {as_of.isoformat()}" if as_of else ""
        raise Problem(
            404,
            "no_calibration_yet",
            f"Nothing has been published for {which} of {vehicle.name!r}{when}.",
            "Publish a result: POST /v1/results/{id}/publication, or ask for a calibration with "
            '"publish": "recommended".',
        )
    if wanted is not None:
        results = [UUID(one["result_id"]) for one in found.values()]
        calibrated = of_results(access.session, results)
        if len(calibrated.cameras) < len(results):
            raise Problem(409, "conflict", "One of the calibrations was deleted at this moment.", "Ask again.")
        return exported(wanted, calibrated, conditions)
    rigs = select(RigCamera.name).join(Rig, Rig.id == RigCamera.rig_id).where(Rig.vehicle_id == vehicle.id)
    names = [] if asked else sorted(set(access.session.scalars(rigs)) - set(found))
    document = jsonable_encoder(
        {"vehicle_id": vehicle.id, "vehicle": vehicle.name, "as_of": as_of, "cameras": found, "without": names}
    )
    conditions.offer(content_etag(content_hash(document)))
    return document
