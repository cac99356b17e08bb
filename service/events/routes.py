"""Server-sent hints of a fleet: what changed, never the change itself."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncGenerator, AsyncIterable
from contextlib import aclosing
from typing import Annotated, Any
from uuid import UUID

import redis.asyncio
from fastapi import APIRouter, Depends, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent
from redis.exceptions import RedisError

from service.auth.access import ReadAccess
from service.db.fleets import Fleet
from service.events.hints import channel
from service.events.patience import tcp_options
from service.http.draining import Drain
from service.settings import Settings

router = APIRouter(tags=["events"])

# Then the browser connects anew, and what the person may see is looked at again.
_LONGEST_S = 600.0
_RECONNECT_S = 1.0
# A process that is asked to stop ends its streams within this time.
_LOOK_UP_S = 0.5


def _followed(id: UUID, access: ReadAccess) -> UUID:
    return access.find(Fleet, id).id


@router.get("/fleets/{id}/events", response_class=EventSourceResponse)
async def get_events(
    request: Request, fleet_id: Annotated[UUID, Depends(_followed)]
) -> AsyncIterable[ServerSentEvent]:
    """Events ``changed`` with {"kind", "id"}. They may be lost: on every connection, read the state again."""
    settings: Settings = request.app.state.settings
    drain: Drain = request.app.state.drain
    end = time.monotonic() + _LONGEST_S
    # At once, so that the client knows it is connected; kind `fleet` says that anything may have changed.
    yield _changed("fleet", str(fleet_id))
    while time.monotonic() < end and not drain.over.is_set():
        try:
            async with aclosing(_hints(settings.events, fleet_id, end, drain)) as found:
                async for one in found:
                    yield _changed(one["kind"], one["id"])
        except RedisError:
            await asyncio.sleep(_RECONNECT_S)
            yield _changed("fleet", str(fleet_id))


async def _hints(url: str, fleet_id: UUID, end: float, drain: Drain) -> AsyncGenerator[dict[str, Any], None]:
    client: Any = redis.asyncio.Redis.from_url(url, socket_connect_timeout=2, **tcp_options(url))
    async with client, client.pubsub(ignore_subscribe_messages=True) as subscription:
        await subscription.subscribe(channel(fleet_id))
        while (left := end - time.monotonic()) > 0 and not drain.over.is_set():
            message = await subscription.get_message(timeout=min(left, _LOOK_UP_S))
            if message is not None:
                yield json.loads(message["data"])


def _changed(kind: str, id: str) -> ServerSentEvent:
    return ServerSentEvent(event="changed", data={"kind": kind, "id": id})
