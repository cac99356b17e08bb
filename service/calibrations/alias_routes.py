"""Routes of a camera's aliases: where they lead, their moves, and moving them."""

from __future__ import annotations

from uuid import UUID

from fastapi.responses import JSONResponse

from apexcal.documents.base import Sought
from apexcal.documents.publications import CURRENT, AliasMoveRequest, AliasMoveView, AliasName
from service.auth.access import ReadAccess, WriteAccess
from service.broker.hints import hint
from service.calibration_runs.alias_actions import OfCamera, Words, move_alias, newest_moves
from service.calibration_runs.publication_actions import hold_publications, hold_to_publish
from service.calibrations.publication_rules import check_objections, check_publishable
from service.calibrations.publication_views import alias_moves, newest_moves_view
from service.db.calibrations import Calibration, Result
from service.db.fleets import Vehicle
from service.http.pages import Page, Paging
from service.http.problems import Problem, not_found
from service.http.router import Router

router = Router(tags=["calibrations"])

_PATH = "/vehicles/{vehicle_id}/cameras/{camera}/aliases"
# A list of them is one page. People have two or three.
_MOST = 100


@router.get(_PATH)
def list_aliases(vehicle_id: UUID, camera: Sought, access: ReadAccess) -> Page[AliasMoveView]:
    """Where each alias of a camera leads beside `current`, by its last move."""
    moves = newest_moves(access.session, access.find(Vehicle, vehicle_id).id, camera)
    return Page(items=newest_moves_view(access.session, moves))


@router.get(_PATH + "/{alias}/moves")
def list_moves(
    vehicle_id: UUID, camera: Sought, alias: AliasName, access: ReadAccess, window: Paging
) -> Page[AliasMoveView]:
    """Where an alias led, newest first: since when, by whom, why, against which objections."""
    return alias_moves(access.session, access.find(Vehicle, vehicle_id).id, camera, alias, window)


@router.post(_PATH + "/{alias}/moves", status_code=201, response_model=AliasMoveView)
def post_move(
    vehicle_id: UUID, camera: Sought, alias: AliasName, body: AliasMoveRequest, access: WriteAccess
) -> JSONResponse:
    """Let an alias lead to a result of the camera, or nowhere, with a reason. [reviewer]

    Against the service's objections only with ``override``, as for a publication. `current` moves by publishing.
    """
    vehicle = access.find(Vehicle, vehicle_id, "reviewer")
    session = access.session
    if alias == CURRENT:
        raise Problem(
            422,
            "alias_is_published",
            "`current` leads to what was published last.",
            "Publish the result (POST /v1/results/{id}/publication), or withdraw the publication.",
        )
    result = _result(access, vehicle, camera, body.result_id)
    if result is None:
        hold_publications(session, vehicle.id)
        against: list[str] = []
    else:
        check_publishable(result)
        if hold_to_publish(session, result) is None:
            raise not_found()
        against = check_objections(session, result, is_overridden=body.override)
    moves = newest_moves(session, vehicle.id, camera)
    _check_place(alias, body.result_id, {one.alias: one.result_id for one in moves})
    words = Words(access.person.id, body.reason, against)
    row = move_alias(session, OfCamera(vehicle.fleet_id, vehicle.id, camera), alias, result, words)
    hint(session, vehicle.fleet_id, "calibration", row.result_id or row.id)
    return access.answer(newest_moves_view(session, [row])[0])


def _result(access: WriteAccess, vehicle: Vehicle, camera: str, result_id: UUID | None) -> Result | None:
    if result_id is None:
        return None
    result = access.find(Result, result_id, "reviewer")
    if result.camera != camera or access.find(Calibration, result.calibration_id).vehicle_id != vehicle.id:
        raise Problem(
            409,
            "of_another_camera",
            "This result is of another camera or vehicle.",
            f"Take one of the camera {camera!r} of {vehicle.name!r}.",
        )
    return result


def _check_place(alias: str, wanted: UUID | None, known: dict[str, UUID | None]) -> None:
    if wanted is None and known.get(alias) is None:
        raise Problem(
            409, "alias_leads_nowhere", f"The alias {alias!r} leads nowhere already.", "Say to which result it shall."
        )
    if alias not in known and len(known) >= _MOST:
        raise Problem(
            409, "too_many_aliases", f"A camera has at most {_MOST} aliases.", "Move one that is there already."
        )
