"""The clock's side of the farm: beat, and the one small worker that sweeps when beat says so.

It is no pool process of the workers that solve, so a farm whose every process is busy for an hour is still swept.
Started by name: ``celery -A workers.sweeper beat`` and ``celery -A workers.sweeper worker --pool solo -Q sweep``.
"""

from __future__ import annotations

from celery.signals import beat_init, task_prerun, worker_init

from service.jobs.messages import SWEEP
from service.settings import settings_or_exit
from workers.app import make_app
from workers.stalls import expect_progress

settings = settings_or_exit()

app = make_app("workers.tasks.sweeping")
app.conf.beat_schedule = {
    "sweep": {
        "task": SWEEP,
        "schedule": settings.sweep_s,
        # An old message says nothing that a new one does not. Sender and receiver each look at their own clock for
        # this, so it is far longer than any two clocks are apart: else nothing would ever be swept.
        "options": {"queue": "sweep", "expires": 3600.0},
    }
}


@beat_init.connect
@worker_init.connect
@task_prerun.connect
def _gets_on(**_: object) -> None:
    """A start, and each sweep, is progress; so is each tick of beat, in :mod:`workers.alive`."""
    expect_progress()
