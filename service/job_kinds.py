"""The table of all kinds of jobs, and what follows what. :mod:`service.platform.jobs.kinds` imports it by name."""

from __future__ import annotations

from service.analyses import jobs as analyses
from service.calibration_runs import jobs as calibration_runs
from service.detections import jobs as detections
from service.platform.jobs.kinds import register
from service.publications.conclusion_actions import publish_conclusion
from service.recordings import jobs as recordings

KINDS = (
    *recordings.kinds(take=analyses.queue_packing),
    *analyses.KINDS,
    *detections.kinds(take=analyses.queue_marks),
    *calibration_runs.KINDS,
    *calibration_runs.conclusions(take=publish_conclusion),
)
register(*KINDS)
