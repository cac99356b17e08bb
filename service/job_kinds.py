"""The table of all kinds of jobs. Who makes, does or sweeps jobs imports it."""

from __future__ import annotations

from service.analyses import jobs as analyses
from service.calibration_runs import jobs as calibration_runs
from service.detections import jobs as detections
from service.platform.jobs.kinds import register
from service.recordings import jobs as recordings
from service.reports import jobs as reports
from service.validations import jobs as validations

KINDS = (
    *recordings.KINDS,
    *analyses.KINDS,
    *detections.KINDS,
    *calibration_runs.KINDS,
    *reports.KINDS,
    *validations.KINDS,
)
register(*KINDS)
