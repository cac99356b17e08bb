"""The health of a fleet: what each camera of each vehicle is given, how good that is, and what it waits for."""

from __future__ import annotations

from datetime import datetime
from typing import Literal
from uuid import UUID

from apexcal.documents.base import Page, Sent
from apexcal.documents.checks import CheckVerdict
from apexcal.documents.states import CameraState

WaitsFor = Literal["rig", "recording", "calibration", "running_calibration", "look"]
HealthOrder = Literal[
    "vehicle",
    "-vehicle",
    "state",
    "-state",
    "published_at",
    "-published_at",
    "error_20m_mm",
    "-error_20m_mm",
    "recorded_at",
    "-recorded_at",
]


class CameraHealth(Sent):
    """A camera that a vehicle carries now; ``camera`` is null of a vehicle without a rig.

    ``state``: ``published``; ``look`` if the published result does not pass its checks and nobody decided that it
    be used, or if a newer one was kept from being published; ``none`` if nothing was, or its result was deleted;
    ``withdrawn``; ``sensor_swapped`` by the serial numbers; ``unknown`` if the published result was never judged.
    ``verdict`` and ``error_20m_mm`` (one standard deviation 20 m away in the middle of the image) are those of the
    published result. ``published_at`` is the alias's last move. ``recording_id`` is the rig's newest ready recording.
    ``waits_for``: a rig, a recording, a calibration, a running one's end, or a look; null if for none.
    ``calibration_id`` is the calibration to look at: the one that it waits for, or the published one.
    """

    vehicle_id: UUID
    vehicle: str
    camera: str | None
    state: CameraState
    waits_for: WaitsFor | None
    verdict: CheckVerdict | None
    error_20m_mm: float | None
    published_at: datetime | None
    recording_id: UUID | None
    recorded_at: datetime | None
    calibration_id: UUID | None


class FleetHealth(Page[CameraHealth]):
    """A page of a fleet's cameras. ``counts``: how many match the text that was sought, by state."""

    counts: dict[CameraState, int]
