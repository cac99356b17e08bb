"""What answers say of a job."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from pydantic import computed_field

from apexcal.documents.base import Sent
from apexcal.documents.states import WorkState
from service.db.clock import utc_now

# Before this share of the work, or this many seconds, what was done tells too little of what is left.
_LEAST_FRACTION, _LEAST_S = 0.02, 2.0


class JobView(Sent):
    """A unit of work. ``progress`` is {"fraction", "message"}; ``problem`` is {"code", "detail", "hint"}.

    ``seconds_left`` is about how long a running job still takes, by how far it is since it started; null where that
    is not known.
    """

    id: int
    kind: str
    state: WorkState
    attempt: int
    progress: dict[str, Any] | None
    problem: dict[str, Any] | None
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None

    @computed_field
    @property
    def seconds_left(self) -> float | None:
        """See above; to the second."""
        if self.state != WorkState.RUNNING or self.started_at is None or not self.progress:
            return None
        stated = self.progress.get("seconds_left")
        if stated is not None:
            return round(stated)
        fraction = self.progress.get("fraction") or 0.0
        passed = (utc_now() - self.started_at).total_seconds()
        if fraction < _LEAST_FRACTION or passed < _LEAST_S:
            return None
        return round(passed * (1.0 - fraction) / fraction)
