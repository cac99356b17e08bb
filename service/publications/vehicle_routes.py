"""What vehicles ask for when they start: the calibrations of all cameras in one answer, or of one camera."""

from __future__ import annotations

from typing import Annotated, Any
from uuid import UUID

from fastapi import Query, Request
from fastapi.encoders import jsonable_encoder
from fastapi.responses import Response

from apexcal.documents.base import Sought, Stored
from apexcal.documents.exports import UrdfRequest
from apexcal.documents.published_calibrations import CurrentCalibration, VehicleCalibration
from service.exports.answers import WantedFormat, exported
from service.exports.routes import XML, patched_answer
from service.platform.auth.access import ReadAccess
from service.platform.db.base import content_hash
from service.platform.db.fleets import Vehicle
from service.platform.http.etags import Conditional, content_etag
from service.platform.http.router import DOCUMENT, Router
from service.publications.calibration_views import camera_documents
from service.publications.camera_queries import published_exports
from service.publications.retrieval import Retrieval
from service.publications.selection import CameraSelection, Selection, VehicleSelection
from service.publications.vehicle_queries import vehicle_of

router = Router(tags=["calibrations"])

_CAMERA = "/vehicles/{vehicle_id}/cameras/{camera}/calibration"
_NAME = "the vehicle, by its name or id"
_FLEET = "its fleet, by name or id; needed where vehicles of several fleets have this name"
_SENSOR = "the vehicle, by the serial number of its LiDAR or of one of its cameras"


@router.get("/vehicles/{vehicle_id}/calibration", response_model=Stored[VehicleCalibration])
async def read_vehicle_calibration(
    vehicle_id: UUID, request: Request, format_name: WantedFormat, selection: VehicleSelection
) -> Response:
    """What all cameras of a vehicle are given, read at one moment: ``cameras`` by name.

    ``without`` names the cameras that nothing was published for. ``camera`` narrows to some, and each of these must
    have a calibration. If one of the selected cameras was withdrawn, the whole answer is 410 `calibration_withdrawn`;
    if a sensor was swapped, 409 `calibration_does_not_apply`. ``format``: all in another program's format.
    """
    retrieval: Retrieval = request.app.state.retrieval
    return await retrieval.answer(request, vehicle_id, selection, format_name)


@router.get("/calibration", response_model=Stored[VehicleCalibration])
def find_vehicle_calibration(
    request: Request,
    access: ReadAccess,
    format_name: WantedFormat,
    selection: VehicleSelection,
    vehicle: Annotated[Sought | None, Query(description=_NAME)] = None,
    fleet: Annotated[Sought | None, Query(description=_FLEET)] = None,
    sensor: Annotated[Sought | None, Query(description=_SENSOR)] = None,
) -> Response:
    """A whole vehicle's calibration by its name or by a sensor, for cars that do not know the vehicle's id."""
    retrieval: Retrieval = request.app.state.retrieval
    of = vehicle_of(access, vehicle, fleet, sensor)
    return retrieval.answer_within(access.session, request, of, selection, format_name)


@router.get(_CAMERA, response_model=Stored[CurrentCalibration])
def read_current(
    vehicle_id: UUID,
    camera: Sought,
    access: ReadAccess,
    conditions: Conditional,
    format_name: WantedFormat,
    selection: CameraSelection,
) -> dict[str, Any] | Response:
    """The calibration that a vehicle's camera is given: intrinsics and transform, both frames named.

    410 `calibration_withdrawn` where it was withdrawn, 409 `calibration_does_not_apply` where a sensor was swapped.
    ``format``, or the format's type in Accept: the same as a file for another program.
    """
    vehicle = access.find(Vehicle, vehicle_id)
    selection = selection._replace(cameras=[camera])
    if format_name is not None:
        return exported(format_name, published_exports(access.session, vehicle, selection), conditions)
    document = jsonable_encoder(camera_documents(access.session, vehicle, selection)[camera])
    conditions.offer(content_etag(content_hash(document)))
    return document


@router.post(_CAMERA + "/urdf", max_body_size=DOCUMENT, response_class=Response, responses=XML)
def patch_urdf(vehicle_id: UUID, camera: Sought, body: UrdfRequest, access: ReadAccess) -> Response:
    """The sent URDF with one joint's origin as the camera's current calibration has it; all other bytes stay.

    Or the sent calibration file of Autoware with the pose of the ``joint``'s child. Nothing is stored.
    """
    vehicle = access.find(Vehicle, vehicle_id)
    return patched_answer(body, published_exports(access.session, vehicle, Selection([camera])))
