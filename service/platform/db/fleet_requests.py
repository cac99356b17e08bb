"""Tables of fleet requests and the outcome of each of their vehicles."""

from __future__ import annotations

from datetime import datetime
from uuid import UUID

from sqlalchemy import Index, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.platform.db.base import Created, Dated, Json, Row, belongs_to, partial_index, refers_to


class FleetRequest(Dated):
    """One call for calibrations of many vehicles.

    ``asked`` is the filter and the calibration's template. How far it is say its vehicles. Those that had not ended
    were put to work at ``started_at``, by the request or by its newest retry. Whoever cancels or retries locks it.
    """

    __table_args__ = (Index("ix_fleet_request_fleet_id_id", "fleet_id", "id"),)

    fleet_id: Mapped[UUID] = belongs_to("fleet.id")
    asked: Mapped[Json]
    request_id: Mapped[str | None] = mapped_column(String(64))
    cancel_requested: Mapped[bool] = mapped_column(default=False)
    created_by: Mapped[UUID | None] = refers_to("person.id")
    started_at: Mapped[Created]


class FleetRequestVehicle(Row):
    """A vehicle of a fleet request: queued until its calibration ends, then done, failed or cancelled; or skipped.

    A queued one without a calibration is due: the upkeep makes it.
    Whether a queued one is being worked on shows in its jobs, not in this row. Ids sort by the vehicles' names.
    """

    __table_args__ = (
        UniqueConstraint("fleet_request_id", "vehicle_id"),
        # With what the counts of a request need.
        Index("ix_fleet_request_vehicle_state", "fleet_request_id", "state", "id", "finished_at"),
        Index("ix_fleet_request_vehicle_fleet_request_id_id", "fleet_request_id", "id"),
        partial_index(
            "ix_fleet_request_vehicle_due",
            "fleet_request_id",
            "id",
            where="state = 'queued' AND calibration_id IS NULL",
        ),
    )

    fleet_request_id: Mapped[UUID] = belongs_to("fleet_request.id", index=False)
    vehicle_id: Mapped[UUID] = belongs_to("vehicle.id")
    calibration_id: Mapped[UUID | None] = refers_to("calibration.id")
    state: Mapped[str] = mapped_column(String(20))
    problem: Mapped[Json | None]
    finished_at: Mapped[datetime | None]
