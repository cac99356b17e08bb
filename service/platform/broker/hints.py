"""Hints that something changed, published through the broker once the change is committed.

They may be lost: whoever follows them reads the state again, so nothing depends on one arriving.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Sequence
from typing import Any, NamedTuple
from uuid import UUID

from sqlalchemy.orm import Session

from service.platform.db.session import post

COURIER = "events"

_QUIET_S = 2.0

log = logging.getLogger(__name__)


class Hint(NamedTuple):
    """A change of one thing in a fleet."""

    fleet_id: UUID
    kind: str
    id: str


def hint(session: Session, fleet_id: UUID, kind: str, id: UUID | int | str) -> None:
    """Tell the fleet's followers, after this session's commit, that ``kind`` ``id`` changed."""
    post(session, COURIER, Hint(fleet_id, kind, str(id)))


_CHANNEL = "apexcal:fleet:"
# The pattern of all of them.
EVERY_CHANNEL = _CHANNEL + "*"


def channel(fleet_id: UUID) -> str:
    """The broker's channel of a fleet."""
    return f"{_CHANNEL}{fleet_id}"


def fleet_of(channel: str) -> UUID:
    """The fleet of a channel."""
    return UUID(channel.removeprefix(_CHANNEL))


class Publisher:
    """The courier of hints: ``database.couriers[COURIER] = Publisher(settings.events)``."""

    def __init__(self, url: str) -> None:
        import redis  # imported late: processes that only need the channels' names load no broker client

        self._lost = redis.RedisError
        self._client: Any = redis.Redis.from_url(url, socket_timeout=1, socket_connect_timeout=0.5)
        self._quiet_until = 0.0

    def __call__(self, hints: Sequence[Hint]) -> None:
        """Publish; where the broker does not answer, the hints are lost and the next ones wait a moment."""
        if time.monotonic() < self._quiet_until:
            return
        try:
            with self._client.pipeline(transaction=False) as pipeline:
                # Repeating a hint adds nothing.
                for hint in dict.fromkeys(hints):
                    pipeline.publish(channel(hint.fleet_id), json.dumps({"kind": hint.kind, "id": hint.id}))
                pipeline.execute()
        except self._lost as error:
            self._quiet_until = time.monotonic() + _QUIET_S
            log.warning("hints are lost for %g s: the broker does not answer (%s)", _QUIET_S, error)

    def close(self) -> None:
        """Close the connections to the broker."""
        self._client.close()
