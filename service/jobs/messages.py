"""Celery messages: hints that say "look at job N", and nothing more."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

from celery import Celery
from kombu.exceptions import OperationalError

from service.broker.connection import TCP

RUN_JOB = "apexcal.run_job"
SWEEP = "apexcal.sweep"
COURIER = "jobs"

log = logging.getLogger(__name__)


class Message(NamedTuple):
    """Which job to look at, in which queue."""

    job_id: int
    queue: str


class Sender:
    """Sends messages; one that cannot be sent now is sent by the sweep later."""

    def __init__(self, broker_url: str) -> None:
        self._app = Celery("apexcal-sender", broker=broker_url, set_as_current=False)
        self._app.conf.update(
            task_ignore_result=True,
            broker_connection_retry=False,
            # A broker that is away must not hold up the request that posts to it: kombu would try for seconds.
            broker_transport_options={
                **TCP,
                "socket_connect_timeout": 1,
                "socket_timeout": 5,
                "max_retries": 1,
                "interval_start": 0,
                "interval_step": 0.05,
                "interval_max": 0.05,
            },
        )

    def __call__(self, messages: Sequence[Message]) -> None:
        """The courier that a database hands committed messages to."""
        try:
            with self._app.producer_pool.acquire(block=True, timeout=5) as producer:
                for message in messages:
                    self._app.send_task(
                        RUN_JOB, args=(message.job_id,), queue=message.queue, producer=producer, retry=False
                    )
        except OperationalError as error:
            log.warning("the broker does not answer (%s); the sweep sends %d messages later", error, len(messages))

    def close(self) -> None:
        """Close the connections to the broker."""
        self._app.close()
