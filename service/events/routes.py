"""Server-sent hints of a fleet: what changed, never the change itself."""

from __future__ import annotations

from collections.abc import AsyncIterable, AsyncIterator
from typing import Annotated
from uuid import UUID

from fastapi import APIRouter, Depends, Request
from fastapi.sse import EventSourceResponse, ServerSentEvent

from service.auth.access import CurrentIdentity, ReadAccess
from service.auth.roles import Role
from service.db.fleets import Fleet
from service.events.fanout import Fanout
from service.events.following import Follower, anything
from service.events.hints import Hint
from service.http.problems import not_found

router = APIRouter(tags=["events"])

# Then the browser connects anew, perhaps to another process.
_LONGEST_S = 600.0
# A stream that made room for a newer one comes back after so long, else it would push that one out at once.
_COMES_BACK_MS = 30_000


def _role(id: UUID, access: ReadAccess) -> Role:
    role = access.role(access.find(Fleet, id).id)
    if role is None:
        raise not_found()
    return role


async def _follower(
    id: UUID, request: Request, identity: CurrentIdentity, role: Annotated[Role, Depends(_role)]
) -> AsyncIterator[Follower]:
    fanout: Fanout = request.app.state.fanout
    with fanout.follow(identity, id, role) as follower:
        yield follower


@router.get("/fleets/{id}/events", response_class=EventSourceResponse)
async def get_events(follower: Annotated[Follower, Depends(_follower)]) -> AsyncIterable[ServerSentEvent]:
    """Events ``changed`` with {"kind", "id"}. They may be lost: on every connection, read the state again.

    A person follows with up to twelve streams in each process; the oldest ends when one more begins.
    """
    # At once, so that the client knows it is connected; kind `fleet` says that anything may have changed.
    yield _changed(anything(follower.fleet_id))
    async for one in follower.hints(_LONGEST_S):
        yield _changed(one)
    if follower.gives_way:
        yield ServerSentEvent(comment="a newer stream of the same person took its place", retry=_COMES_BACK_MS)


def _changed(one: Hint) -> ServerSentEvent:
    return ServerSentEvent(event="changed", data={"kind": one.kind, "id": one.id})
