"""Calibrations, their results, and what a vehicle's camera is given."""

from __future__ import annotations

from typing import Annotated
from uuid import UUID

from fastapi import Query, Request
from fastapi.responses import JSONResponse
from sqlalchemy import select

from apexcal.documents.base import Sought
from apexcal.documents.calibrations import CalibrationRequest, CalibrationView, CameraLens, SlotView
from apexcal.documents.errors import DocumentError
from apexcal.documents.recordings import RecordingView
from service.annotations.disclosure_actions import disclose_pairs
from service.calibrations.actions import ask_to_end, create
from service.calibrations.lens_queries import state_lens, with_recorded_lenses
from service.calibrations.plan import plan_request
from service.calibrations.resolve import CameraPairs
from service.calibrations.views import calibration_views, slot_page, vertices_apart
from service.fleets.rigs import rig_camera
from service.platform.auth.access import Access, ReadAccess, WriteAccess
from service.platform.broker.hints import hint
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Slot
from service.platform.db.fleets import Rig, Vehicle
from service.platform.db.recordings import Recording
from service.platform.http.etags import Conditional
from service.platform.http.pages import LongPaging, Page, Paging, fetch
from service.platform.http.problems import Problem, unprocessable
from service.platform.http.router import Router
from service.recordings.actions import delete_calibration
from service.recordings.queries import view

router = Router(tags=["calibrations"])


@router.put("/recordings/{id}/cameras/{camera}/lens")
def put_lens(id: UUID, camera: str, body: CameraLens, access: WriteAccess, conditions: Conditional) -> RecordingView:
    """State the lens of a recording's camera: marks and calibrations from now on begin with it. [engineer]"""
    row = access.find(Recording, id, "engineer", lock=True)
    conditions.edit(row)
    state_lens(access.session, row, camera, body)
    access.session.flush()
    hint(access.session, row.fleet_id, "recording", row.id)
    return view(access.session, row)


@router.post("/vehicles/{vehicle_id}/calibrations", status_code=202, response_model=CalibrationView)
def ask_calibration(
    vehicle_id: UUID, body: CalibrationRequest, reader: ReadAccess, access: WriteAccess
) -> JSONResponse:
    """Fit models to a vehicle's correspondences: one set for each camera, all of one rig. [engineer]"""
    # Planned before anything is locked: 100,000 pairs take a second.
    try:
        sources = _sources(reader, vehicle_id, body.correspondence_set_ids)
        plan = plan_request(body, with_recorded_lenses(reader.session, body, sources))
    except (DocumentError, Problem):
        _ = access.session  # which raises the answer that this request got before
        raise
    reader.session.close()
    _sources(access, vehicle_id, body.correspondence_set_ids)
    (calibration,) = create(access.session, [plan], body.farm, body.publish, access.person.id, coming=plan.runs)
    hint(access.session, calibration.fleet_id, "calibration", calibration.id)
    return access.answer(calibration_views(access.session, [calibration])[0], 202)


def _sources(access: Access, vehicle_id: UUID, set_ids: list[UUID]) -> list[CameraPairs]:
    """The cameras of the sets, all of one rig, in the order of their names."""
    vehicle = access.find(Vehicle, vehicle_id, "engineer")
    sets = [access.find(CorrespondenceSet, set_id, "engineer") for set_id in set_ids]
    for pair_set in sets:
        if pair_set.vehicle_id != vehicle.id:
            raise unprocessable(
                "set_of_another_vehicle",
                f"The correspondence set {pair_set.id} belongs to another vehicle.",
                "Ask for the calibration at the vehicle of the set.",
            )
    if len({pair_set.rig_id for pair_set in sets}) > 1:
        raise unprocessable(
            "rigs_differ",
            "The correspondence sets belong to different rigs of the vehicle.",
            "Ask for one calibration for each rig.",
        )
    cameras = [pair_set.camera for pair_set in sets]
    twice = next((camera for camera in cameras if cameras.count(camera) > 1), None)
    if twice is not None:
        raise unprocessable(
            "camera_twice",
            f"More than one correspondence set is of the camera {twice}.",
            "Give one set for each camera.",
        )
    rig = access.find(Rig, sets[0].rig_id, "engineer")
    sources = [CameraPairs(rig_camera(access.session, rig, pair_set.camera), pair_set) for pair_set in sets]
    return sorted(sources, key=lambda source: source.camera.name)


@router.get("/vehicles/{vehicle_id}/calibrations")
def list_calibrations(vehicle_id: UUID, access: ReadAccess, window: Paging) -> Page[CalibrationView]:
    """A vehicle's calibrations, newest first. Their notes for reviewers."""
    vehicle = access.find(Vehicle, vehicle_id)
    with_notes = access.sees_answers(vehicle.fleet_id)
    statement = select(Calibration).where(Calibration.vehicle_id == vehicle.id)
    rows, following = fetch(access.session, statement, Calibration.id, window, newest_first=True)
    return Page(items=calibration_views(access.session, rows, with_notes=with_notes), next=following)


@router.get("/calibrations/{calibration_id}")
def read_calibration(calibration_id: UUID, access: ReadAccess, request: Request) -> CalibrationView:
    """A calibration: how far it is, and when it is done its models side by side.

    Reviewers see its notes, and which vertices two cameras put apart. Where these were marked here, what a reviewer
    answers on them afterwards counts as reviewed.
    """
    calibration = access.find(Calibration, calibration_id)
    with_pairs = access.sees_answers(calibration.fleet_id)
    view = calibration_views(access.session, [calibration], with_pairs=with_pairs, with_notes=with_pairs)[0]
    if with_pairs and vertices_apart(calibration.summary):
        runs = select(CalibrationRun.set_id).where(CalibrationRun.calibration_id == calibration.id)
        for pairs in access.session.scalars(select(CorrespondenceSet).where(CorrespondenceSet.id.in_(runs))).all():
            disclose_pairs(access, request.app.state.database, pairs, "calibration")
    return view


@router.post("/calibrations/{calibration_id}/cancel", status_code=202)
def cancel_calibration(calibration_id: UUID, access: WriteAccess) -> CalibrationView:
    """Ask for the end of a calibration; what has ended stays as it is. [engineer]"""
    calibration = access.find(Calibration, calibration_id, "engineer")
    ask_to_end(access.session, select(Calibration.id).where(Calibration.id == calibration.id))
    hint(access.session, calibration.fleet_id, "calibration", calibration.id)
    return calibration_views(access.session, [calibration])[0]


@router.delete("/calibrations/{calibration_id}", status_code=204)
def remove_calibration(calibration_id: UUID, access: WriteAccess) -> None:
    """Delete a calibration with its results, unless one is published. Its pairs stay. [engineer]"""
    calibration = access.find(Calibration, calibration_id, "engineer")
    hint(access.session, calibration.fleet_id, "calibration", calibration_id)
    delete_calibration(access.session, calibration)


@router.get("/calibrations/{calibration_id}/slots")
def list_slots(
    calibration_id: UUID,
    access: ReadAccess,
    window: LongPaging,
    camera: Annotated[Sought | None, Query()] = None,
    model: Annotated[Sought | None, Query()] = None,
    fold: Annotated[int | None, Query(ge=-1, le=20)] = None,
) -> Page[SlotView]:
    """What the slots of a calibration found, and who computed them."""
    calibration = access.find(Calibration, calibration_id)
    statement = select(CalibrationRun, Slot).join(Slot, Slot.run_id == CalibrationRun.id)
    statement = statement.where(CalibrationRun.calibration_id == calibration.id)
    for column, value in (
        (CalibrationRun.camera, camera),
        (CalibrationRun.model, model),
        (CalibrationRun.fold, fold),
    ):
        if value is not None:
            statement = statement.where(column == value)
    return slot_page(access.session, statement, window)
