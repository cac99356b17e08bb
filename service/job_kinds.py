"""The table of all kinds of jobs, and what follows what. :mod:`service.platform.jobs.kinds` imports it by name."""

from __future__ import annotations

from uuid import UUID

from sqlalchemy.orm import Session

from service.analyses import jobs as analyses
from service.calibration_runs import jobs as calibration_runs
from service.detections import jobs as detections
from service.platform.db.recordings import Recording
from service.platform.jobs.kinds import register
from service.publications.conclusion_actions import publish_conclusion
from service.recordings import jobs as recordings


def _follow_reading(session: Session, recording_id: UUID, recording: Recording) -> None:
    """Describe the rig of a recording that came without one."""
    # Imported here: it needs NumPy, and the service that queues jobs does not.
    from service.imports.proposing import describe_empty_rig

    describe_empty_rig(session, recording)


KINDS = (
    *recordings.kinds(take=_follow_reading),
    *analyses.KINDS,
    *detections.kinds(take=analyses.queue_marks),
    *calibration_runs.kinds(conclude=publish_conclusion),
)
register(*KINDS)
