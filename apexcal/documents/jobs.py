"""Jobs, how far they are, and why they failed."""

from __future__ import annotations

from datetime import datetime

from apexcal.documents.base import Document, Sent, Stored
from apexcal.documents.states import WorkState


class ProblemView(Document):
    """Why something failed or was refused: a stable ``code``, what is wrong, what to do. Some have more fields."""

    code: str = "unknown"
    detail: str | None = None
    hint: str | None = None


class JobProgress(Document):
    """Progress of a job, as its worker reports it."""

    fraction: float | None = None
    message: str | None = None
    seconds_left: float | None = None


class WorkerStanding(Sent):
    """How many workers answer, and the kinds of waiting jobs that none of these workers takes.

    A worker counts as answering until it has been silent for 8 s. It also answers while it compiles its kernels.
    """

    answering: int
    unserved: list[str]


class JobView(Sent):
    """A unit of work.

    ``seconds_left`` estimates how long a running job still takes, from the share done since it started. It is null if
    that share is not known.
    """

    id: int
    kind: str
    state: WorkState
    attempt: int
    progress: Stored[JobProgress | None]
    problem: Stored[ProblemView | None]
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    seconds_left: float | None = None
