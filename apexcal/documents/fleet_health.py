"""The health of a fleet: what each vehicle gets for each camera, how good that is, and what it waits for."""

from __future__ import annotations

from datetime import datetime
from typing import Literal
from uuid import UUID

from apexcal.documents.base import Page, Sent
from apexcal.documents.checks import CheckVerdict
from apexcal.documents.states import CameraState, CameraWork

HealthOrder = Literal[
    "vehicle",
    "-vehicle",
    "state",
    "-state",
    "work",
    "-work",
    "published_at",
    "-published_at",
    "error_20m_mm",
    "-error_20m_mm",
    "recorded_at",
    "-recorded_at",
]


class CameraHealth(Sent):
    """A camera that a vehicle carries now. A vehicle without cameras has a row too, with null camera and state.

    ``state`` is what the vehicle gets: a ``published`` calibration, or none because it was ``withdrawn``, or because
    nothing was published or its result was deleted (``none``). ``verdict``, of its checks as they say today (null if
    it was never judged), and ``error_20m_mm`` (one standard deviation 20 m away in the middle of the image) are those
    of the published result. ``is_swapped``: the vehicle carries other sensors now, by their serial numbers.
    ``published_at`` is the alias's last move. ``recording_id`` is the rig's newest ready recording.
    ``work`` is what is to be done: a ``decision`` if the published result does not pass its checks and nobody decided
    that it be used, or if a newer one was not published; else the end of a ``running`` calibration, ``marks``, a
    ``recording``, or ``nothing``. ``calibration_id`` is the calibration to look at: the one that it waits for, or the
    published one.
    """

    vehicle_id: UUID
    vehicle: str
    camera: str | None
    state: CameraState | None
    work: CameraWork
    verdict: CheckVerdict | None
    is_swapped: bool
    error_20m_mm: float | None
    published_at: datetime | None
    recording_id: UUID | None
    recorded_at: datetime | None
    calibration_id: UUID | None


class FleetHealth(Page[CameraHealth]):
    """A page of a fleet's cameras, of which ``matching`` match all that was asked.

    ``counts``: how many match by state, whatever state was asked for. ``work_counts``: the same by work.
    """

    matching: int
    counts: dict[CameraState, int]
    work_counts: dict[CameraWork, int]
