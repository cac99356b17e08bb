"""The queues in which jobs wait. A kind of job names one of them (:mod:`service.platform.jobs.kinds`).

A worker's Celery application reads this alone: it starts without SQLAlchemy.
"""

from __future__ import annotations

# For each queue the setting that caps a fleet's jobs there, sent or running; None where there is no cap.
_CAPS: dict[str, str | None] = {
    # The maker of a file decides how long it takes to read: one fleet must not hold every process.
    "ingest": "fleet_ingests",
    "detect": None,
    # A run takes at most half a minute (decision 0032), so nobody waits longer for a process.
    "solve": None,
    # A queue of its own: a conclusion takes a moment and ends a calibration, so it must not wait behind runs.
    "report": None,
}
QUEUES = tuple(_CAPS)
FLEET_CAPS = {queue: cap for queue, cap in _CAPS.items() if cap}
