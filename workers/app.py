"""Celery as apexcal uses it: JSON, early acknowledgement, no results, nothing prefetched.

The job table knows the rest. Started by name: ``celery -A workers.app worker``.
"""

from __future__ import annotations

import logging
from typing import Any

from celery import Celery
from celery.signals import celeryd_init, setup_logging, worker_init
from kombu.transport import TRANSPORT_ALIASES

from service.platform.broker.connection import CONSUMER
from service.platform.garbage import imports_done
from service.platform.jobs.kinds import QUEUES
from service.platform.observability import logs
from service.platform.settings import get_settings, settings_or_exit
from workers import alive

# By name: kombu loads it with the first connection.
TRANSPORT_ALIASES.update(dict.fromkeys(("redis", "rediss"), "workers.transport:Transport"))


@celeryd_init.connect
@setup_logging.connect
def start_logging(loglevel: Any = logging.INFO, **_: object) -> None:
    """Log as the API does; Celery leaves logging alone where somebody answers the second of these signals.

    The first comes before a worker says anything.
    """
    logs.configure(get_settings().log_form, loglevel if isinstance(loglevel, int) else logging.INFO)


@worker_init.connect
def start_collecting(**_: object) -> None:
    """The tasks are imported; this comes before the forks, which then share what it made."""
    imports_done()


def _make_app() -> Celery:
    settings = settings_or_exit()
    app = Celery("apexcal", broker=settings.broker, include=["workers.tasks.entry"])
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
        worker_send_task_events=settings.celery_events,
        # Off: a worker takes no orders through the broker, neither to end nor to leave a queue (docs/operators.md).
        worker_enable_remote_control=settings.celery_control,
        broker_connection_retry_on_startup=True,
        broker_connection_max_retries=None,
        broker_transport_options=CONSUMER,
        enable_utc=True,
    )
    alive.install(app)
    return app


app = _make_app()
