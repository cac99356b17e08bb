"""Celery messages: hints that say "look at job N", and nothing more.

A message is a Celery task, named after the kind of its job and routed to the kind's queue by Celery.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from service.platform.broker.connection import TCP
from service.platform.jobs.kinds import kinds
from service.platform.settings import get_settings

if TYPE_CHECKING:
    from celery import Celery

COURIER = "jobs"

log = logging.getLogger(__name__)


class Message(NamedTuple):
    """Which job to look at, and its kind."""

    job_id: int
    kind: str


def task_of(kind: str) -> str:
    """Return the name of the Celery task for jobs of this kind."""
    return f"apexcal.{kind}"


def routes() -> dict[str, dict[str, str]]:
    """Return Celery's ``task_routes``: the queue of each kind's task."""
    return {task_of(kind.name): {"queue": kind.queue} for kind in kinds()}


class Sender:
    """Sends messages; the reaper sends later what cannot be sent now."""

    def __init__(self, broker_url: str) -> None:
        self._broker_url = broker_url

    @cached_property
    def _app(self) -> Celery:
        from celery import Celery  # a tenth of the service's start, so it waits for the first message

        app = Celery("apexcal-sender", broker=self._broker_url, set_as_current=False)
        app.conf.update(
            task_ignore_result=True,
            task_routes=routes(),
            task_send_sent_event=get_settings().celery_events,
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
        return app

    def __call__(self, messages: Sequence[Message]) -> None:
        """The courier that a database hands committed messages to."""
        from kombu.exceptions import OperationalError

        try:
            with self._app.producer_pool.acquire(block=True, timeout=5) as producer:
                for message in messages:
                    name = task_of(message.kind)
                    self._app.send_task(name, args=(message.job_id,), producer=producer, retry=False)
        except OperationalError as error:
            log.warning("the broker does not answer (%s); the reaper sends %d messages later", error, len(messages))

    def close(self) -> None:
        """Close the connections to the broker, if there were messages."""
        if "_app" in self.__dict__:
            self._app.close()
