"""What fleet requests and their answers look like."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated
from uuid import UUID

from pydantic import AwareDatetime, Field

from apexcal.documents.base import Document, Name, Received, Sent, Stored
from apexcal.documents.calibrations import CalibrationTemplate, ProgressView
from apexcal.documents.checks import Check, CheckVerdict
from apexcal.documents.jobs import ProblemView
from apexcal.documents.states import RequestState, VehicleState


class VehicleFilter(Received):
    """The vehicles of the fleet that meet every given condition. Without conditions, all vehicles.

    ``name`` and ``rig`` are a part of the name, as in the fleet's table, or patterns of the whole name: ``*`` stands
    for any characters, ``?`` for one. Case does not count. ``rig`` also decides which rig of a vehicle is calibrated.
    ``not_calibrated_since`` leaves out vehicles calibrated since that moment.
    ``new_pairs`` keeps only vehicles with a camera whose newest pairs are not those of its published calibration.
    """

    vehicle_ids: Annotated[list[UUID], Field(min_length=1, max_length=5000)] | None = None
    name: Name | None = None
    rig: Name | None = None
    not_calibrated_since: AwareDatetime | None = None
    new_pairs: bool = False


class FleetRequestBody(Received):
    """A calibration of many vehicles; ``dry_run`` only predicts it."""

    vehicles: VehicleFilter
    calibration: CalibrationTemplate = CalibrationTemplate.model_validate({})
    dry_run: bool = False


class AskedVehicles(Document):
    """A filter as it was asked. ``named`` is how many vehicles it named by id, null where it named none."""

    named: int | None = None
    name: Name | None = None
    rig: Name | None = None
    not_calibrated_since: AwareDatetime | None = None
    new_pairs: bool = False


class AskedOfFleet(Document):
    """What was asked: the filter, and the calibration of each vehicle."""

    vehicles: AskedVehicles
    calibration: CalibrationTemplate


class Counts(Sent):
    """How many vehicles the filter matched, and how many of them are in which state."""

    matched: int
    queued: int
    running: int
    done: int
    failed: int
    cancelled: int
    skipped: int


class FleetRequestView(Sent):
    """A fleet request: what was asked and by whom, how far it is, and how many vehicles are in which state.

    ``asked_by`` is null if the person is no longer known. ``published`` counts the vehicles for which the service or
    a person published a result of this request. It is null while the request runs, or if it asked for no publication.
    """

    id: UUID
    fleet_id: UUID
    state: RequestState
    asked: Stored[AskedOfFleet]
    asked_by: str | None
    counts: Counts
    published: int | None
    progress: ProgressView
    seconds_left: int | None
    cancel_requested: bool
    created_at: datetime
    finished_at: datetime | None


class CameraOutcome(Sent):
    """What a vehicle's calibration recommends for a camera, and its mean errors in pixels.

    ``status`` is the result's. If it is not ``ok``, the errors say little, however small. ``verdict`` is the gravest
    of its checks when the calibration ended, and ``checks`` has those that did not pass, the gravest first.
    ``published`` says whether it became the camera's current calibration; null if nobody asked for that.
    """

    model: str | None
    mean_px: float | None
    heldout_mean_px: float | None
    status: str | None
    verdict: CheckVerdict | None
    checks: list[Check]
    published: bool | None


class RequestVehicleView(Sent):
    """A vehicle of a fleet request. ``problem`` says why it failed, was skipped or was cancelled."""

    vehicle_id: UUID
    vehicle: str
    state: VehicleState
    calibration_id: UUID | None
    problem: Stored[ProblemView | None]
    cameras: dict[str, CameraOutcome]
    finished_at: datetime | None


class SkippedView(Sent):
    """A vehicle that would be skipped, and why."""

    vehicle_id: UUID
    vehicle: str
    problem: Stored[ProblemView]


class SkipReason(Sent):
    """Why ``count`` vehicles would be skipped; ``examples`` are the names of the first twelve."""

    detail: str
    hint: str
    count: int
    examples: list[str]


class DryRunView(Sent):
    """The prediction for a fleet request. A run is a fit of one model to one camera's pairs.

    ``processor_seconds`` is the longest time that the runs may take on one processor. Most schedules end after a
    third of it. ``skipped_vehicles`` names the first hundred, ``reasons`` count all of the skipped.
    """

    matched: int
    calibrations: int
    runs: int
    processor_seconds: int
    skipped: int
    reasons: list[SkipReason]
    skipped_vehicles: list[SkippedView]
