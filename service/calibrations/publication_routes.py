"""Routes of results and publications, and of a camera's current calibration."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from fastapi import Request
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse, Response
from sqlalchemy import select

from apexcal.documents.base import Sought, Stored
from apexcal.documents.publications import PublicationRequest, PublicationView, WithdrawalRequest
from apexcal.documents.results import ResultView
from apexcal.documents.roles import rank
from apexcal.documents.summaries import CurrentCalibration
from service.annotations.disclosure_actions import tell_pairs
from service.auth.access import ReadAccess, WriteAccess
from service.broker.hints import hint
from service.calibration_runs.alias_actions import Words
from service.calibration_runs.objection_queries import comparison, objections
from service.calibration_runs.publication_actions import (
    current_publication,
    hold_publications,
    hold_to_publish,
    is_withdrawn,
    publish,
    was_given,
    withdraw,
    withdrawal_of,
)
from service.calibrations.asked import AskedOfCamera
from service.calibrations.given_views import given_documents
from service.calibrations.publication_rules import check_objections, check_publishable
from service.calibrations.publication_views import publication_page, publication_view
from service.calibrations.views import result_document
from service.db.calibrations import FULL, Calibration, CalibrationRun, CorrespondenceSet, Publication, Result
from service.db.digests import content_hash
from service.db.fleets import Vehicle
from service.exports.answers import WantedFormat, exported
from service.exports.queries import of_given, of_result
from service.http.etags import Conditional, content_etag
from service.http.pages import Page, Paging
from service.http.problems import Problem, not_found
from service.http.router import Router

router = Router(tags=["calibrations"])


@router.get("/results/{result_id}", response_model=Stored[ResultView])
def read_result(
    result_id: UUID, access: ReadAccess, request: Request, wanted: WantedFormat, conditions: Conditional
) -> dict[str, Any] | Response:
    """The solver's whole document: parameters, errors of every stage, deviations, alarms; and its ids.

    ``objections`` is what speaks against publishing it now, null of a fit that is not to all pairs. Of pairs made of
    marks only reviewers see what tells of single pairs; what they answer afterwards on the vertices of these counts
    as reviewed. ``format``: its lens and mount in another format.
    """
    result = access.find(Result, result_id)
    if wanted is not None:
        return exported(wanted, of_result(access.session, result.id), conditions)
    found = access.session.execute(
        select(CalibrationRun, Calibration, CorrespondenceSet)
        .join(Calibration, Calibration.id == CalibrationRun.calibration_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(CalibrationRun.id == result.run_id)
    ).one_or_none()
    if found is None:
        # Deleted at this moment.
        raise not_found()
    run, calibration, pairs = found
    with_pairs = pairs.source == "import" or rank(access.role(result.fleet_id) or "") >= rank("reviewer")
    against = objections(access.session, result) if result.fold == FULL else None
    document = result_document(result, run, calibration, pairs, against, with_pairs=with_pairs)
    document["compared"] = comparison(access.session, result, calibration.vehicle_id) if result.fold == FULL else None
    if with_pairs:
        tell_pairs(access, request.app.state.database, pairs, "result")
    return document


@router.post("/results/{result_id}/publication", status_code=201, response_model=PublicationView)
def publish_result(result_id: UUID, access: WriteAccess, wanted: PublicationRequest | None = None) -> JSONResponse:
    """Publish a result for its vehicle's camera; the current one is answered again, with 200. [reviewer]

    Against the service's objections only with an ``override``, which is kept. One that was published before takes a
    ``reason``: this is how to go back.
    """
    result = access.find(Result, result_id, "reviewer")
    check_publishable(result)
    session = access.session
    calibration = hold_to_publish(session, result)
    if calibration is None:
        raise not_found()
    newest = current_publication(session, calibration.vehicle_id, result.camera)
    if newest is not None and newest.result_id == result.id and not is_withdrawn(session, newest):
        return access.answer(publication_view(session, newest), 200)
    row = publish(session, calibration, result, _words(access, result, wanted or PublicationRequest()))
    hint(session, result.fleet_id, "calibration", calibration.id)
    return access.answer(publication_view(session, row))


def _words(access: WriteAccess, result: Result, wanted: PublicationRequest) -> Words:
    """Raises :class:`Problem` 409 ``objections`` and 422 ``reason_missing``."""
    against = check_objections(access.session, result, is_overridden=wanted.override is not None)
    reason = wanted.override.reason if wanted.override else wanted.reason
    if reason is None and was_given(access.session, result):
        raise Problem(
            422,
            "reason_missing",
            "This result was published before, and another one after it.",
            'Say why it is given again: {"reason": "..."}.',
        )
    return Words(access.person.id, reason, against)


@router.post("/publications/{publication_id}/withdrawal", status_code=201, response_model=PublicationView)
def withdraw_publication(publication_id: UUID, body: WithdrawalRequest, access: WriteAccess) -> JSONResponse:
    """Withdraw a publication, and say why; if it is withdrawn already, the answer is 200. [reviewer]

    If it is the camera's current one, the camera is given nothing and `current` answers 410 `calibration_withdrawn`
    until something is published: the one before does not come back by itself. Aliases that lead to the same result
    are removed.
    """
    session = access.session
    hold_publications(session, access.find(Publication, publication_id, "reviewer").vehicle_id)
    publication = session.get(Publication, publication_id, populate_existing=True)
    if publication is None:
        # Deleted at this moment.
        raise not_found()
    if withdrawal_of(session, publication) is not None:
        return access.answer(publication_view(session, publication), 200)
    withdraw(session, publication, access.person.id, body.reason)
    hint(session, publication.fleet_id, "calibration", publication.result_id)
    return access.answer(publication_view(session, publication))


@router.get("/vehicles/{vehicle_id}/cameras/{camera}/publications")
def list_publications(vehicle_id: UUID, camera: Sought, access: ReadAccess, window: Paging) -> Page[PublicationView]:
    """What a vehicle's camera was given, newest first: by whom, when, why and against which objections."""
    return publication_page(access.session, access.find(Vehicle, vehicle_id).id, camera, window)


@router.get("/vehicles/{vehicle_id}/cameras/{camera}/calibration", response_model=Stored[CurrentCalibration])
def read_current(
    vehicle_id: UUID,
    camera: Sought,
    access: ReadAccess,
    conditions: Conditional,
    wanted: WantedFormat,
    asked: AskedOfCamera,
) -> dict[str, Any] | Response:
    """The calibration that a vehicle's camera is given: intrinsics and transform, both frames named.

    410 `calibration_withdrawn` where it was withdrawn, 409 `calibration_does_not_apply` where a sensor was swapped.
    ``format``, or the format's type in Accept: the same as a file for another program.
    """
    vehicle = access.find(Vehicle, vehicle_id)
    asked = asked._replace(cameras=[camera])
    if wanted is not None:
        return exported(wanted, of_given(access.session, vehicle, asked), conditions)
    document = jsonable_encoder(given_documents(access.session, vehicle, asked)[camera])
    conditions.offer(content_etag(content_hash(document)))
    return document
