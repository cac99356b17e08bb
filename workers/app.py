"""Celery as apexcal uses it: JSON, early acknowledgement, no results, nothing prefetched.

The job table knows the rest. Started by name: ``celery -A workers.app worker`` does jobs; ``celery -A
workers.sweeper`` is the clock's side.
"""

from __future__ import annotations

import logging
from typing import Any

from celery import Celery
from celery.signals import celeryd_init, setup_logging

from service.broker.connection import CONSUMER
from service.jobs.kinds import QUEUES
from service.observability import logs
from service.settings import get_settings, settings_or_exit
from workers import alive, transport


@celeryd_init.connect
@setup_logging.connect
def start_logging(loglevel: Any = logging.INFO, **_: object) -> None:
    """Log as the API does; Celery leaves logging alone where somebody answers the second of these signals.

    The first comes before a worker says anything.
    """
    logs.configure(get_settings().log_form, loglevel if isinstance(loglevel, int) else logging.INFO)


def make_app(tasks: str) -> Celery:
    """A Celery application that knows the tasks of one module."""
    settings = settings_or_exit()
    transport.install()
    app = Celery("apexcal", broker=settings.broker, include=[tasks])
    app.conf.update(
        task_serializer="json",
        accept_content=["json"],
        task_ignore_result=True,
        task_acks_late=False,
        task_time_limit=settings.task_limit_s,
        task_default_queue=QUEUES[0],
        worker_prefetch_multiplier=1,
        worker_disable_prefetch=True,
        worker_hijack_root_logger=False,
        worker_redirect_stdouts=False,
        worker_send_task_events=False,
        # A worker takes no orders through the broker, neither to end nor to leave a queue (docs/operators.md).
        worker_enable_remote_control=False,
        broker_connection_retry_on_startup=True,
        broker_connection_max_retries=None,
        broker_transport_options=CONSUMER,
        enable_utc=True,
    )
    alive.install(app)
    return app


app = make_app("workers.tasks.entry")
