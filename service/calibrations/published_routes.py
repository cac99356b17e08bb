"""Results, their publication, and the current calibration of a vehicle's camera at one address."""

from __future__ import annotations

from typing import Any
from uuid import UUID

from fastapi import APIRouter, Request
from fastapi.encoders import jsonable_encoder
from fastapi.responses import JSONResponse
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.annotations.disclosure import tell_pairs
from service.auth.access import ReadAccess, WriteAccess
from service.auth.roles import rank
from service.calibrations.runs import FULL
from service.calibrations.schemas import PublicationView
from service.calibrations.views import current_document, publication_view, result_document
from service.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Publication, Result
from service.db.fleets import Rig, Vehicle
from service.detections.digests import content_hash
from service.events.hints import hint
from service.http.etags import Conditional, content_etag
from service.http.problems import Problem
from service.http.schemas import Sought

router = APIRouter()


@router.get("/results/{result_id}")
def read_result(result_id: UUID, access: ReadAccess, request: Request) -> dict[str, Any]:
    """The solver's whole document: parameters, errors of every stage, deviations, alarms; and its ids.

    Of pairs made of marks only reviewers see what tells of single pairs; what they answer afterwards on the
    vertices of these counts as reviewed.
    """
    result = access.find(Result, result_id)
    run, calibration, pairs = access.session.execute(
        select(CalibrationRun, Calibration, CorrespondenceSet)
        .join(Calibration, Calibration.id == CalibrationRun.calibration_id)
        .join(CorrespondenceSet, CorrespondenceSet.id == CalibrationRun.set_id)
        .where(CalibrationRun.id == result.run_id)
    ).one()
    with_pairs = pairs.source == "import" or rank(access.role(result.fleet_id) or "") >= rank("reviewer")
    document = result_document(result, run, calibration, pairs, with_pairs=with_pairs)
    if with_pairs:
        tell_pairs(access, request.app.state.database, pairs, "result")
    return document


@router.post("/results/{result_id}/publication", status_code=201, response_model=PublicationView)
def publish(result_id: UUID, access: WriteAccess) -> JSONResponse:
    """Give a result to its vehicle's camera; the current one is found again, with 200. [reviewer]"""
    result = access.find(Result, result_id, "reviewer")
    if result.fold != FULL:
        raise Problem(
            409,
            "not_publishable",
            "This result left a block of the pairs out, to measure the model on it.",
            "Publish the result of the same model that was fitted to all pairs.",
        )
    calibration = access.session.get_one(Calibration, result.calibration_id)
    current = _current(access.session, calibration.vehicle_id, result.camera)
    if current is not None and current.result_id == result.id:
        return access.answer(publication_view(current), 200)
    row = Publication(
        fleet_id=result.fleet_id,
        vehicle_id=calibration.vehicle_id,
        camera=result.camera,
        result_id=result.id,
        published_by=access.person.id,
    )
    access.session.add(row)
    access.session.flush()
    hint(access.session, result.fleet_id, "calibration", calibration.id)
    return access.answer(publication_view(row))


@router.get("/vehicles/{vehicle_id}/cameras/{camera}/calibration")
def read_current(vehicle_id: UUID, camera: Sought, access: ReadAccess, conditions: Conditional) -> dict[str, Any]:
    """The current calibration of a vehicle's camera: intrinsics and transform, both frames named."""
    vehicle = access.find(Vehicle, vehicle_id)
    publication = _current(access.session, vehicle.id, camera)
    if publication is None:
        raise Problem(
            404,
            "no_calibration_yet",
            f"Nothing has been published for the camera {camera!r} of {vehicle.name!r}.",
            "Publish a result: POST /v1/results/{id}/publication, or ask for a calibration with "
            '"publish": "recommended".',
        )
    result = access.session.get_one(Result, publication.result_id)
    calibration = access.session.get_one(Calibration, result.calibration_id)
    rig = access.session.get_one(Rig, calibration.rig_id)
    document = jsonable_encoder(current_document(publication, result, calibration, rig))
    conditions.offer(content_etag(content_hash(document)))
    return document


def _current(session: Session, vehicle_id: UUID, camera: str) -> Publication | None:
    return session.scalar(
        select(Publication)
        .where(Publication.vehicle_id == vehicle_id, Publication.camera == camera)
        .order_by(Publication.created_at.desc(), Publication.id.desc())
        .limit(1)
    )
