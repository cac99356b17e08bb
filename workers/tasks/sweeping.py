"""The Celery task that sweeps."""

from __future__ import annotations

from service.jobs.messages import SWEEP
from service.jobs.sweep import sweep
from workers.sweeper import app
from workers.tasks.context import get_context
from workers.tasks.leftovers import remove_leftovers


@app.task(name=SWEEP)
def sweep_once() -> None:
    """See :mod:`service.jobs.sweep`."""
    context = get_context()
    sweep(context.database, context.store)
    remove_leftovers(context.settings.scratch)
