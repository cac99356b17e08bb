"""All that a vehicle is given, in one answer: what a car asks for when it starts."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Annotated, Any
from uuid import UUID

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response
from fastapi.routing import APIRoute

from apexcal.documents.base import Sought, Stored
from apexcal.documents.exports import VehicleCalibration
from apexcal.documents.publications import CURRENT
from service.auth.access import ReadAccess
from service.calibrations.asked import AskedOfVehicle
from service.calibrations.retrieval import Retrieval
from service.calibrations.vehicle_queries import vehicle_of
from service.exports.answers import WantedFormat, format_of_accept
from service.exports.given_queries import Asked

_USUAL = Asked((), CURRENT, None, {})


class _UsualFirst(APIRoute):
    """Answers a car's usual request, which has no query, before FastAPI looks for six parameters.

    Looking for them takes a quarter of the time of an answer 304.
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """What FastAPI calls for a request."""
        whole = super().get_route_handler()

        async def handle(request: Request) -> Response:
            vehicle_id = _usual_vehicle(request)
            if vehicle_id is None:
                return await whole(request)
            retrieval: Retrieval = request.app.state.retrieval
            return await retrieval.answer(request, vehicle_id, _USUAL, None)

        return handle


def _usual_vehicle(request: Request) -> UUID | None:
    """The vehicle that is asked for in JSON and without a query; None for any other question."""
    named = request.path_params.get("vehicle_id")
    if named is None or request.scope["query_string"] or format_of_accept(request) is not None:
        return None
    try:
        return UUID(named)
    except ValueError:
        return None


router = APIRouter(tags=["calibrations"], route_class=_UsualFirst)

_NAME = "the vehicle, by its name or id"
_FLEET = "its fleet, by name or id; needed where vehicles of several fleets have this name"
_SENSOR = "the vehicle, by the serial number of its LiDAR or of one of its cameras"


@router.get("/vehicles/{vehicle_id}/calibration", response_model=Stored[VehicleCalibration])
async def read_vehicle_calibration(
    vehicle_id: UUID, request: Request, wanted: WantedFormat, asked: AskedOfVehicle
) -> Response:
    """What all cameras of a vehicle are given, read at one moment: ``cameras`` by name.

    ``without`` names the cameras that nothing was published for. ``camera`` narrows to some, and each of these must
    have a calibration. If one of the asked cameras was withdrawn, the whole answer is 410 `calibration_withdrawn`;
    if a sensor was swapped, 409 `calibration_does_not_apply`. ``format``: all in another program's format.
    """
    retrieval: Retrieval = request.app.state.retrieval
    return await retrieval.answer(request, vehicle_id, asked, wanted)


@router.get("/calibration", response_model=Stored[VehicleCalibration])
def find_vehicle_calibration(
    request: Request,
    access: ReadAccess,
    wanted: WantedFormat,
    asked: AskedOfVehicle,
    vehicle: Annotated[Sought | None, Query(description=_NAME)] = None,
    fleet: Annotated[Sought | None, Query(description=_FLEET)] = None,
    sensor: Annotated[Sought | None, Query(description=_SENSOR)] = None,
) -> Response:
    """The same for the vehicle of this name, or with this sensor: for cars that do not know the vehicle's id."""
    retrieval: Retrieval = request.app.state.retrieval
    found = vehicle_of(access, vehicle, fleet, sensor)
    return retrieval.answer_now(request, access.identity, found.id, asked, wanted)
