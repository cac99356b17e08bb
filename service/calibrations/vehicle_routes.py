"""All that a vehicle is given, in one answer: what a car asks for when it starts."""

from __future__ import annotations

import re
from typing import Annotated
from uuid import UUID

from fastapi import Query, Request
from fastapi.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from apexcal.documents.base import Sought, Stored
from apexcal.documents.exports import VehicleCalibration
from service.auth.access import ReadAccess
from service.calibrations.asked import AskedOfVehicle
from service.calibrations.retrieval import Retrieval
from service.calibrations.vehicle_queries import vehicle_of
from service.exports.answers import WantedFormat, format_of_accept
from service.http.router import Router

router = Router(tags=["calibrations"])

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


_ROUTE = router.routes[0]
_USUAL_PATH = re.compile("/v1/vehicles/([0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12})/calibration")


class UsualFirst:
    """ASGI middleware. Answers a car's usual request, one in JSON and without a query, before the router sees it.

    The way through the router takes a third of the time of an answer 304. What is not answered at once goes that way.
    """

    def __init__(self, app: ASGIApp, retrieval: Retrieval) -> None:
        self._app = app
        self._retrieval = retrieval

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection."""
        answer = await self._answer(scope) if scope["type"] == "http" and scope["method"] == "GET" else None
        if answer is None:
            await self._app(scope, receive, send)
            return
        scope["route"] = _ROUTE
        await answer(scope, receive, send)

    async def _answer(self, scope: Scope) -> Response | None:
        usual = _USUAL_PATH.fullmatch(scope["path"])
        if usual is None or scope["query_string"]:
            return None
        request = Request(scope)
        if format_of_accept(request) is not None:
            return None
        return await self._retrieval.answer_at_once(request, UUID(usual[1]))
