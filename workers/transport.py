"""Kombu's Redis transport, with which nothing that the broker says or fails to say stops a worker.

Messages are hints: of a job whose message is lost the sweep sends another.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from queue import Empty
from typing import Any

from kombu.transport import redis, virtual

PAUSE = threading.Event()
"""Set while this worker cannot reach the database: messages are left to others."""

log = logging.getLogger(__name__)


class QoS(redis.QoS):
    """Counts the messages in hand; a worker that has as many as it may takes no more.

    A message leaves the count also where the broker could not be told, which Celery only logs. Else the worker would
    wait for ever with free hands. The broker gives such a message out again an hour later, which does no harm.
    """

    def can_consume(self) -> bool:
        """Whether another message may be taken."""
        return not PAUSE.is_set() and super().can_consume()

    def ack(self, delivery_tag: str) -> None:
        """The message was taken."""
        try:
            super().ack(delivery_tag)
        finally:
            virtual.QoS.ack(self, delivery_tag)

    def reject(self, delivery_tag: str, requeue: bool = False) -> None:
        """The message was not taken."""
        try:
            super().reject(delivery_tag, requeue)
        finally:
            virtual.QoS.ack(self, delivery_tag)


class Channel(redis.Channel):
    """Reads the queues."""

    QoS = QoS

    def _brpop_read(self, **options: Any) -> Any:
        try:
            return super()._brpop_read(**options)
        except (ValueError, RecursionError) as error:  # no JSON, or no text
            log.warning("dropped what is no message: %s", error)
            raise Empty from None


class Transport(redis.Transport):
    """Hands on what the channels read."""

    Channel = Channel

    def _deliver(self, message: Any, queue: str) -> None:
        try:
            super()._deliver(message, queue)
        except (*self.connection_errors, *self.channel_errors):
            raise
        except Exception as error:
            log.warning("dropped a message in %s that cannot be read: %s: %s", queue, type(error).__name__, error)
            self._forget(message)

    def _forget(self, message: Any) -> None:
        """Give it up, so that it does not count as work in hand."""
        for channel in self.channels or ():
            with contextlib.suppress(KeyError, TypeError):
                tag = message["properties"]["delivery_tag"]
                channel.qos.get(tag)
                channel.basic_reject(tag, requeue=False)
