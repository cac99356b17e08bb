"""Routes of publications: publishing a result, withdrawing it, and where aliases lead and led."""

from __future__ import annotations

from typing import Annotated, Any, Literal
from uuid import UUID

from fastapi import Query
from fastapi.responses import JSONResponse, Response

from apexcal.documents.base import Sought
from apexcal.documents.fleet_health import FleetHealth, HealthOrder
from apexcal.documents.publications import CURRENT, AliasName, PublicationRequest, PublicationView, WithdrawalRequest
from apexcal.documents.states import CameraState, CameraWork
from service.platform.auth.access import ReadAccess, WriteAccess
from service.platform.broker.hints import hint
from service.platform.db.calibrations import Publication, Result, current_publication
from service.platform.db.fleets import Fleet, Vehicle
from service.platform.http.pages import Page, Paging
from service.platform.http.problems import not_found
from service.platform.http.router import Router
from service.publications.actions import Grounds, hold_publications, hold_to_publish, publish, withdraw
from service.publications.health_queries import fleet_health
from service.publications.queries import newest_publications, withdrawal_of
from service.publications.rules import check_alias, check_current, check_publishable, grounds_of
from service.publications.views import health_table, publication_page, publication_view, publication_views

router = Router(tags=["publications"])

_CSV: dict[int | str, dict[str, Any]] = {200: {"content": {"text/csv": {"schema": {"type": "string"}}}}}
_CAMERA = "/vehicles/{vehicle_id}/cameras/{camera}"


@router.post("/results/{result_id}/publication", status_code=201, response_model=PublicationView)
def publish_result(result_id: UUID, access: WriteAccess, body: PublicationRequest | None = None) -> JSONResponse:
    """Publish a result for its vehicle's camera; if the alias leads to it already, the answer is 200. [reviewer]

    Against a check of `stop` only with an ``override``, which is kept with the sentences of the checks. One that was
    published before takes a ``reason``: this is how to go back.
    """
    content = body or PublicationRequest()
    result = access.find(Result, result_id, "reviewer")
    check_publishable(result)
    session = access.session
    calibration = hold_to_publish(session, result)
    if calibration is None:
        raise not_found()
    current = current_publication(session, calibration.vehicle_id, result.camera, content.alias)
    if current is not None and current.result_id == result.id:
        return access.answer(publication_view(session, current), 200)
    check_alias(session, calibration.vehicle_id, result.camera, content.alias)
    grounds = grounds_of(session, result, content, access.person.id)
    row = publish(session, calibration, result, grounds, content.alias)
    hint(session, result.fleet_id, "calibration", calibration.id)
    return access.answer(publication_view(session, row))


@router.post("/publications/{publication_id}/withdrawal", status_code=201, response_model=PublicationView)
def withdraw_publication(publication_id: UUID, body: WithdrawalRequest, access: WriteAccess) -> JSONResponse:
    """Withdraw what an alias leads to, and say why; the answer is the move to nowhere, 200 for a repeat. [reviewer]

    The camera is then given nothing under this alias (410 `calibration_withdrawn`) until something is published: the
    one before does not come back by itself. If it is `current`, aliases that lead to the same result are removed too.
    """
    session = access.session
    hold_publications(session, access.find(Publication, publication_id, "reviewer").vehicle_id)
    publication = session.get(Publication, publication_id, populate_existing=True)
    if publication is None:
        # Deleted with its vehicle at this moment.
        raise not_found()
    withdrawal = withdrawal_of(session, publication)
    if withdrawal is not None:
        return access.answer(publication_view(session, withdrawal), 200)
    of_alias = (publication.vehicle_id, publication.camera, publication.alias)
    check_current(publication, current_publication(session, *of_alias))
    row = withdraw(session, publication, Grounds(access.person.id, body.reason))
    hint(session, row.fleet_id, "calibration", publication.led_to or row.id)
    return access.answer(publication_view(session, row))


@router.get(_CAMERA + "/publications")
def list_publications(
    vehicle_id: UUID,
    camera: Sought,
    access: ReadAccess,
    window: Paging,
    alias: Annotated[AliasName, Query(description="`current`, or another alias such as `canary`")] = CURRENT,
) -> Page[PublicationView]:
    """What a camera was given under an alias, newest first: by whom, when, why and against which checks."""
    return publication_page(access.session, access.find(Vehicle, vehicle_id).id, camera, alias, window)


@router.get(_CAMERA + "/aliases")
def list_aliases(vehicle_id: UUID, camera: Sought, access: ReadAccess) -> Page[PublicationView]:
    """Where each alias of a camera leads, by its last move."""
    newest = newest_publications(access.find(Vehicle, vehicle_id).id, camera)
    return Page(items=publication_views(access.session, newest))


@router.get("/fleets/{id}/health", response_model=FleetHealth, responses=_CSV)
def get_fleet_health(
    id: UUID,
    access: ReadAccess,
    window: Paging,
    sought: Annotated[Sought, Query(alias="name", description="a part of the vehicle's or camera's name")] = "",
    state: Annotated[list[CameraState], Query(description="only cameras in one of these states")] = [],  # noqa: B006
    work: Annotated[list[CameraWork], Query(description="only cameras that wait for one of these")] = [],  # noqa: B006
    order: Annotated[
        HealthOrder, Query(description="the member to sort by; `-` before it turns it round")
    ] = "vehicle",
    format: Annotated[Literal["json", "csv"], Query(description="csv: all pages in one table")] = "json",
) -> FleetHealth | Response:
    """The cameras of a fleet's vehicles: what each vehicle gets, age, error, last recording, what each waits for."""
    fleet = access.find(Fleet, id)
    page = None if format == "csv" else window
    health = fleet_health(access.session, fleet.id, page, sought, state, work, order)
    if format == "json":
        return health
    headers = {"Content-Disposition": 'attachment; filename="fleet-health.csv"'}
    return Response(health_table(health.items), media_type="text/csv", headers=headers)
