"""The Celery tasks, one for each kind of job, and what a worker does when it starts and when it is told to stop."""

from __future__ import annotations

import logging
import os
from typing import Any

from billiard.process import active_children
from celery.signals import (
    worker_init,
    worker_process_init,
    worker_ready,
    worker_shutdown,
    worker_shutting_down,
)

from apexcal.processes import die_with
from service.platform.jobs.kinds import kinds
from service.platform.jobs.messages import task_of
from service.platform.settings import get_settings
from workers import alive
from workers.app import app
from workers.readers.isolation.isolate import hide_from_others
from workers.readers.limited import isolation_here
from workers.tasks.context import get_context, remove_leftovers
from workers.tasks.drain import DRAIN_SIGNAL, listen_for_drain
from workers.tasks.presence import Presence
from workers.tasks.running import prepare, run_job

log = logging.getLogger(__name__)

_PARENT = os.getpid()  # the pool's processes are forked from the one that loads this module
_LARGEST_ID = 2**63 - 1  # of the column


class JobFailedError(Exception):
    """A job ended as failed, for Celery's events. The database has said so already."""


_KINDS = {task_of(kind.name): kind.name for kind in kinds()}


def look_at_job(task: Any, job_id: int) -> None:
    """Claim the job and do it, or drop the message. What to do says the job's row. Raises :class:`JobFailedError`."""
    if not (isinstance(job_id, int) and 0 < job_id <= _LARGEST_ID):
        log.warning("dropped a message: it names no job")
    elif failure := run_job(get_context(), job_id, _KINDS.get(task.name, "")):
        raise JobFailedError(failure)


for _name in _KINDS:
    app.task(look_at_job, name=_name, bind=True, throws=(JobFailedError,))


@worker_init.connect
def prepare_parent(sender: Any, **_: object) -> None:
    """Load and compile in the parent, so that every forked child has the code already."""
    hide_from_others()
    log.info("processes that read uploads have %s", isolation_here())
    remove_leftovers(get_settings().scratch)
    presence = Presence.of(sender)
    with presence.said_meanwhile(), alive.touched_meanwhile():
        prepare(presence.queues)
    sender.apexcal_presence = presence


@worker_ready.connect
def show_presence(sender: Any, **_: object) -> None:
    """Say every few seconds that this worker answers: from Celery's own loop, so that it is true.

    Not from a thread: a pool process that is forked meanwhile would inherit half a connection. Celery gets ready anew
    whenever the broker comes back.
    """
    presence: Presence = sender.controller.apexcal_presence
    presence.keep_saying(sender.timer)


@worker_shutting_down.connect
def drain_children(**_: object) -> None:
    """Celery's warm shutdown waits for every task; ours may take an hour, so they are given back instead."""
    for child in active_children():
        if child.pid:
            os.kill(child.pid, DRAIN_SIGNAL)


@worker_shutdown.connect
def end_presence(sender: Any, **_: object) -> None:
    """Leave no row behind that somebody could take for a worker."""
    sender.apexcal_presence.end()


@worker_process_init.connect
def prepare_child(**_: object) -> None:
    """Die with the parent, and when it is told to stop give the job in hand back."""
    hide_from_others()
    die_with(_PARENT)
    listen_for_drain()
