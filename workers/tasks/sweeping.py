"""The Celery task that sweeps."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from celery.signals import worker_ready

import service.job_kinds  # noqa: F401  # the sweep asks every kind what its subjects need
from service.jobs.messages import SWEEP
from service.jobs.sweep import sweep, swept_lately
from service.storage.store import Store
from workers.stalls import expect_progress
from workers.sweeper import app
from workers.tasks.context import get_context
from workers.tasks.leftovers import remove_leftovers

# Removing objects is the least urgent thing that a sweep does: a store that hangs must not hold up the next sweep.
_PATIENCE_S = 2.0


@lru_cache(maxsize=1)
def _store() -> Store:
    settings = get_context().settings
    return Store(settings.blobs, replace(settings.s3, timeout_s=min(_PATIENCE_S, settings.store_timeout_s)))


@app.task(name=SWEEP)
def sweep_once() -> None:
    """See :mod:`service.jobs.sweep`."""
    context = get_context()
    if swept_lately(context.database):
        return
    sweep(context.database, _store(), expect_progress)
    remove_leftovers(context.settings.scratch)


@worker_ready.connect
def sweep_at_once(**_: object) -> None:
    """Beat's first message comes after a period, and who starts a service waits for the first sweep."""
    app.send_task(SWEEP, queue="sweep")
