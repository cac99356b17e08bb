"""Kombu's Redis transport, which drops what is not a Celery message instead of ending the worker.

Messages are hints: of a job whose message is lost the sweep sends another.
"""

from __future__ import annotations

import contextlib
import logging
from queue import Empty
from typing import Any

from kombu.transport import redis

log = logging.getLogger(__name__)


class Channel(redis.Channel):
    """Reads the queues."""

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
