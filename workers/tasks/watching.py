"""Whether a job is still wanted, looked up while something else works on it."""

from __future__ import annotations

import time
from typing import Final

from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError

from service.db.jobs import Job
from service.db.session import Database
from service.jobs.claims import CancelledError, Claim, Lease, LostLeaseError

_EVERY_S: Final = 1.0


class Watch:
    """Looks at a job's row once a second; its lease does so every few seconds only, and writes with it."""

    def __init__(self, database: Database, held: Claim, lease: Lease) -> None:
        self._database, self._held, self._lease = database, held, lease
        self._due = 0.0

    def look(self) -> None:
        """Raise :class:`CancelledError` or :class:`LostLeaseError` where going on is pointless.

        A database that is away says neither: the lease tells when it has ended.
        """
        self._lease.check()
        if time.monotonic() < self._due:
            return
        self._due = time.monotonic() + _EVERY_S
        mine = select(Job.cancel_requested).where(
            Job.id == self._held.job_id, Job.attempt == self._held.attempt, Job.state == "running"
        )
        try:
            with self._database.alone() as connection:
                cancelled = connection.execute(mine).scalar_one_or_none()
        except SQLAlchemyError:
            return
        if cancelled is None:
            raise LostLeaseError
        if cancelled:
            raise CancelledError
