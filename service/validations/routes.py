"""Validations of a vehicle's cameras, comparisons of two results, and how results drift."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Query, Request
from fastapi.responses import JSONResponse
from sqlalchemy import select

from apexcal.documents.base import Sought
from apexcal.documents.comparisons import ResultComparison
from apexcal.documents.roles import rank
from apexcal.documents.validations import Drift, ValidationRequest, ValidationView
from service.annotations.disclosure_actions import tell_pairs
from service.detections.queries import find_camera, ready_recording
from service.platform.auth.access import Access, ReadAccess, WriteAccess
from service.platform.broker.hints import hint
from service.platform.db.calibrations import CorrespondenceSet, Result
from service.platform.db.fleets import Vehicle
from service.platform.db.jobs import Job
from service.platform.db.validations import Validation
from service.platform.http.bodies import DOCUMENT
from service.platform.http.pages import Page, Paging, fetch
from service.platform.http.problems import Problem
from service.platform.http.router import Router
from service.validations.comparison_queries import comparison_of
from service.validations.drift_queries import drift_of
from service.validations.jobs import queue_validation
from service.validations.queries import validated
from service.validations.views import validation_view

router = Router(tags=["validations"])


@router.post(
    "/vehicles/{vehicle_id}/validations",
    status_code=202,
    response_model=ValidationView,
    max_body_size=DOCUMENT,
)
def ask_validation(vehicle_id: UUID, wanted: ValidationRequest, access: WriteAccess) -> JSONResponse:
    """Test a calibration on pairs that it was not fitted to, or on a drive. [engineer]"""
    vehicle = access.find(Vehicle, vehicle_id, "engineer")
    if wanted.set_id is not None:
        _check_set(access, vehicle, wanted, wanted.set_id)
    elif wanted.recording_id is not None:
        recording = ready_recording(access, wanted.recording_id, "engineer")
        _check_vehicle(vehicle, recording.vehicle_id, "recording")
        find_camera(access.session, recording.id, wanted.camera)
    found = validated(access, vehicle, wanted)
    row = Validation(
        fleet_id=vehicle.fleet_id,
        vehicle_id=vehicle.id,
        recording_id=wanted.recording_id,
        set_id=wanted.set_id,
        result_id=found.result_id,
        kind=wanted.kind,
        camera=wanted.camera,
        asked={"calibration": found.document},
    )
    access.session.add(row)
    access.session.flush()
    job = queue_validation(access.session, row)
    hint(access.session, row.fleet_id, "validation", row.id)
    return access.answer(validation_view(row, job, with_pairs=False), 202)


def _check_set(access: Access, vehicle: Vehicle, wanted: ValidationRequest, set_id: UUID) -> None:
    pairs = access.find(CorrespondenceSet, set_id, "engineer")
    _check_vehicle(vehicle, pairs.vehicle_id, "correspondence set")
    if pairs.camera != wanted.camera:
        raise Problem(
            422,
            "set_of_another_camera",
            f"The correspondence set is of the camera {pairs.camera!r}, not of {wanted.camera!r}.",
            "Name the camera of the set.",
        )


def _check_vehicle(vehicle: Vehicle, vehicle_id: UUID, noun: str) -> None:
    if vehicle_id != vehicle.id:
        raise Problem(
            422,
            "data_of_another_vehicle",
            f"The {noun} belongs to another vehicle, whose sensors are mounted elsewhere.",
            f"Ask for the validation at the vehicle of the {noun}.",
        )


@router.get("/vehicles/{vehicle_id}/validations")
def list_validations(vehicle_id: UUID, access: ReadAccess, window: Paging) -> Page[ValidationView]:
    """The validations of a vehicle, newest first, without single pairs."""
    vehicle = access.find(Vehicle, vehicle_id)
    statement = select(Validation).where(Validation.vehicle_id == vehicle.id)
    rows, following = fetch(access.session, statement, Validation.id, window, newest_first=True)
    ids = [row.job_id for row in rows]
    jobs = {job.id: job for job in access.session.scalars(select(Job).where(Job.id.in_(ids)))}
    views = [validation_view(row, jobs.get(row.job_id or 0), with_pairs=False) for row in rows]
    return Page(items=views, next=following)


@router.get("/validations/{validation_id}")
def read_validation(validation_id: UUID, access: ReadAccess, request: Request) -> ValidationView:
    """A validation. Of pairs made of marks only reviewers see single ones, and what they answer afterwards on their
    vertices counts as reviewed.
    """
    row = access.find(Validation, validation_id)
    job = access.session.get(Job, row.job_id) if row.job_id else None
    pairs = access.session.get(CorrespondenceSet, row.set_id) if row.set_id else None
    with_pairs = (
        pairs is None or pairs.source == "import" or rank(access.role(row.fleet_id) or "") >= rank("reviewer")
    )
    view = validation_view(row, job, with_pairs=with_pairs)
    if pairs is not None and with_pairs and row.result is not None:
        tell_pairs(access, request.app.state.database, pairs, "result")
    return view


@router.get("/results/{result_id}/comparison")
def compare_results(
    result_id: UUID, access: ReadAccess, other: Annotated[UUID, Query(description="the id of another result")]
) -> ResultComparison:
    """How far a result is from another one of its camera: the mount, the lens, and pixels over the image."""
    return comparison_of(access.session, access.find(Result, result_id), access.find(Result, other))


@router.get("/vehicles/{vehicle_id}/drift")
def read_drift(
    vehicle_id: UUID,
    access: ReadAccess,
    camera: Annotated[Sought, Query(description="a camera's name in the rig")],
    limit: Annotated[int, Query(ge=2, le=100, description="how many of the newest results at most")] = 20,
    after: Annotated[str | None, Query(max_length=200, description="the `next` of the answer before")] = None,
) -> Drift:
    """A camera's recommended results in their order, and how far each is from the one before and from the first."""
    vehicle = access.find(Vehicle, vehicle_id)
    return drift_of(access.session, vehicle.id, camera, limit, after)
