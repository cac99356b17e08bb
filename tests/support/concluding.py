"""The conclusion of a calibration up to its last transaction, which a test commits when it likes."""

from __future__ import annotations

from collections.abc import Callable
from uuid import UUID

from sqlalchemy.orm import Session

from service.platform.db.calibrations import Calibration
from service.platform.jobs.claims import Lease, claim
from service.platform.jobs.kinds import kind_of
from service.platform.jobs.queue import enqueue
from workers.tasks.concluding import conclude
from workers.tasks.context import Context


def conclusion(context: Context, calibration_id: UUID) -> Callable[[Session], object]:
    """What the job of a calibration whose runs have ended computed, as the function that writes it."""
    with context.database.writing() as session:
        fleet_id = session.get_one(Calibration, calibration_id).fleet_id
        job_id = enqueue(session, kind="conclude", fleet_id=fleet_id, subject_id=calibration_id).id
    held = claim(context.database, job_id, "w")
    assert held is not None
    with Lease(context.database, held) as lease:
        hand_over = conclude(context, held, lease)
    take = kind_of("conclude").take
    assert take is not None
    return lambda session: take(session, calibration_id, hand_over(session))
