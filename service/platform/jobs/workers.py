"""Workers that answer."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.platform.db.clock import now
from service.platform.db.jobs import Worker

# A worker says every 2 s that it is there. It takes up to 5 s where the database answers slowly.
SILENT_S = 8.0


def answering_workers(session: Session) -> Sequence[Worker]:
    """Return the workers that said within `SILENT_S` that they are there, also those that still compile."""
    return session.scalars(select(Worker).where(Worker.at.between(now(-SILENT_S), now()))).all()
