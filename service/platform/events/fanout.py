"""All event streams of this process: one subscription feeds them, one query a second checks their credentials."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import AsyncGenerator, Iterator
from contextlib import contextmanager
from typing import Any
from uuid import UUID

from fastapi.concurrency import run_in_threadpool

from apexcal.documents.roles import Role
from service.platform.auth.access import Identity, renewed
from service.platform.broker.connection import tcp_options
from service.platform.broker.hints import EVERY_CHANNEL, Hint, fleet_of
from service.platform.db.session import Database
from service.platform.events.follower import Follower, anything
from service.platform.http.draining import Drain
from service.platform.http.problems import Problem

# A person has a stream for each fleet page that is in view; twelve windows side by side are more than anybody reads.
STREAMS_OF_A_PERSON = 12
# Half of the connections that a process takes by itself.
STREAMS_OF_A_PROCESS = 500
# After this long, a person who was removed, signed out or given another role hears nothing more.
CHECK_S = 1.0
_TICK_S = 0.25
# Answers on one detection are told of so far apart.
MARKING_APART_S = 2.0
# The broker is asked whether it still lives, and believed dead when it has not answered meanwhile.
_PING_S = 5.0
_RECONNECT_S = 1.0

log = logging.getLogger(__name__)


class Fanout:
    """Followers of this process. Used from one event loop, in which :meth:`feed` and :meth:`watch` run."""

    def __init__(self, url: str, database: Database, drain: Drain) -> None:
        self._url = url
        self._database = database
        self._drain = drain
        self._followers: list[Follower] = []
        self._check_due = 0.0
        # When a hint of a marking may be told again, and whether it came meanwhile.
        self._markings: dict[Hint, tuple[float, bool]] = {}

    @contextmanager
    def follow(self, identity: Identity, fleet_id: UUID, role: Role) -> Iterator[Follower]:
        """Follow a fleet. The person's oldest stream ends where this one is too many.

        Raises :class:`Problem` 503 ``too_many_streams`` where the process has as many as it takes.
        """
        own = [follower for follower in self._followers if follower.identity.person.id == identity.person.id]
        if len(own) >= STREAMS_OF_A_PERSON:
            self._end(own[0], gives_way=True)
        if len(self._followers) >= STREAMS_OF_A_PROCESS:
            raise _too_many()
        follower = Follower(identity, fleet_id, role)
        self._followers.append(follower)
        if self._drain.over.is_set():
            follower.end()
        try:
            yield follower
        finally:
            if follower in self._followers:
                self._followers.remove(follower)

    async def feed(self) -> None:
        """Hand the broker's hints to the followers, until cancelled."""
        is_reported = False
        while True:
            try:
                async for hint in _hints(self._url):
                    if hint is None:  # earlier hints may be lost
                        is_reported = False
                        for follower in self._followers:
                            follower.tell(anything(follower.fleet_id))
                    elif hint.kind != "marking":
                        self._tell(hint)
                    elif hint in self._markings:
                        self._markings[hint] = (self._markings[hint][0], True)
                    else:
                        self._tell_marking(hint)
            except Exception as error:  # whatever it is, streams must be fed again
                if not is_reported:
                    log.warning("streams of events wait for the broker: %r", error)
                is_reported = True
            await asyncio.sleep(_RECONNECT_S)

    def _tell(self, hint: Hint) -> None:
        for follower in self._followers:
            if follower.fleet_id == hint.fleet_id:
                follower.tell(hint)
        if hint.kind == "member":
            self._check_due = 0.0

    def _tell_marking(self, hint: Hint) -> None:
        """Tell that somebody answered. Forty annotators do so sixty times a second, and each page reads again."""
        self._tell(hint)
        self._markings[hint] = (time.monotonic() + MARKING_APART_S, False)

    def _tell_late(self) -> None:
        now = time.monotonic()
        for marking, (due, came) in list(self._markings.items()):
            if due <= now:
                del self._markings[marking]
                if came:
                    self._tell_marking(marking)

    async def watch(self) -> None:
        """End the streams of a service that stops, and of people who may follow no more, until cancelled."""
        while True:
            await asyncio.sleep(_TICK_S)
            self._tell_late()
            if self._drain.over.is_set():
                for follower in list(self._followers):
                    self._end(follower)
            elif self._followers and time.monotonic() >= self._check_due:
                self._check_due = time.monotonic() + CHECK_S
                await self._check()

    async def _check(self) -> None:
        """End the streams of people who may no longer follow, or whose role has changed."""
        try:
            ended = await run_in_threadpool(self._without_right, list(self._followers))
        except Exception:  # whatever it is, the next look must come
            log.exception("whether followers may still follow is not known; it is looked at again")
            return
        for follower in ended:
            self._end(follower)

    def _without_right(self, followers: list[Follower]) -> list[Follower]:
        with self._database.reading() as session:
            now = {follower.identity.credential: follower.identity for follower in followers}
            now = {secret: renewed(session, identity) for secret, identity in now.items()}
        roles = ((follower, now[follower.identity.credential]) for follower in followers)
        return [
            follower
            for follower, identity in roles
            if not identity or identity.role(follower.fleet_id) != follower.role
        ]

    def _end(self, follower: Follower, *, gives_way: bool = False) -> None:
        if follower in self._followers:
            self._followers.remove(follower)
            follower.end(gives_way=gives_way)


async def _hints(url: str) -> AsyncGenerator[Hint | None, None]:
    """Hints of all fleets; None whenever the subscription begins anew. Raises an error when the broker is lost."""
    import redis.asyncio  # half as much as the web framework

    client: Any = redis.asyncio.Redis.from_url(url, socket_connect_timeout=2, **tcp_options(url))
    async with client, client.pubsub() as subscription:
        await subscription.psubscribe(EVERY_CHANNEL)
        pinged = answered = time.monotonic()
        yield None
        while True:
            message = await subscription.get_message(timeout=1.0)
            if message is not None:
                answered = time.monotonic()
                if message["type"] == "pmessage":
                    yield Hint(fleet_of(message["channel"].decode()), **json.loads(message["data"]))
            if time.monotonic() - pinged >= _PING_S:
                if answered < pinged:
                    raise redis.RedisError("no answer to a ping")
                pinged = time.monotonic()
                await subscription.ping()


def _too_many() -> Problem:
    return Problem(
        503,
        "too_many_streams",
        f"This process of the service has {STREAMS_OF_A_PROCESS} streams of events already.",
        "Read the state from time to time instead, and try again later.",
        headers={"Retry-After": "60"},
    )
