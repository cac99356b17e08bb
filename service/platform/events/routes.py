"""Server-sent hints of a fleet: what changed, never the change itself."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from typing import Annotated
from uuid import UUID

from fastapi import Depends, Request
from fastapi.responses import StreamingResponse
from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event

from apexcal.documents.roles import Role
from service.platform.auth.access import CurrentIdentity, brief_access
from service.platform.broker.hints import Hint
from service.platform.db.fleets import Fleet
from service.platform.events.fanout import Fanout
from service.platform.events.follower import Follower, anything
from service.platform.http.problems import not_found
from service.platform.http.router import Router

router = Router(tags=["events"])

# Then the browser connects anew, perhaps to another process.
_LONGEST_S = 600.0
# Delay after which a displaced stream reconnects; at once it would displace the newer one.
_COMES_BACK_MS = 30_000
# As the standard recommends: proxies end connections on which nothing passes.
_PING_S = 15.0
# nginx holds nothing back.
_HEADERS = {"Cache-Control": "no-cache", "X-Accel-Buffering": "no"}


class EventStream(StreamingResponse):
    """Server-sent events. The framework's own fail where the client leaves while an event waits for it."""

    media_type = "text/event-stream"


def _role(id: UUID, request: Request, identity: CurrentIdentity) -> Role:
    with brief_access(request, identity) as access:
        role = identity.role(access.find(Fleet, id).id)
    if role is None:
        raise not_found()
    return role


async def _follower(
    id: UUID, request: Request, identity: CurrentIdentity, role: Annotated[Role, Depends(_role)]
) -> AsyncIterator[Follower]:
    fanout: Fanout = request.app.state.fanout
    with fanout.follow(identity, id, role) as follower:
        yield follower


@router.get("/fleets/{id}/events", response_class=EventStream)
async def get_events(follower: Annotated[Follower, Depends(_follower)]) -> EventStream:
    """Events ``changed`` with {"kind", "id"}. They may be lost: on every connection, read the state again.

    A person follows with up to twelve streams in each process; the oldest ends when one more begins.
    """
    return EventStream(_events(follower), headers=_HEADERS)


async def _events(follower: Follower) -> AsyncIterator[bytes]:
    # At once, so that the client knows it is connected; kind `fleet` says that anything may have changed.
    yield _changed(anything(follower.fleet_id))
    async for hint in follower.hints(_LONGEST_S, _PING_S):
        yield KEEPALIVE_COMMENT if hint is None else _changed(hint)
    if follower.gives_way:
        yield format_sse_event(comment="a newer stream of the same person took its place", retry=_COMES_BACK_MS)


def _changed(hint: Hint) -> bytes:
    return format_sse_event(event="changed", data_str=json.dumps({"kind": hint.kind, "id": hint.id}))
