"""Streams of events: so many for a person, one connection to the broker for all, an end with the right to them."""

import asyncio
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from datetime import timedelta
from urllib.parse import urlsplit
from uuid import UUID

import pytest
from sqlalchemy import update

from service.platform.auth.access import Identity
from service.platform.auth.credential_actions import new_secret, secret_hash
from service.platform.broker.hints import Hint
from service.platform.db.clock import utc_now
from service.platform.db.people import ApiToken, BrowserSession, Person
from service.platform.events import fanout
from service.platform.events.follower import Follower, anything
from tests.support.broker import Broker
from tests.support.people import Actor, Api
from tests.support.processes import wait_until

# The end comes within a look and a bit; without it a stream goes on for ever.
PATIENCE_S = 60.0
END = b"0\r\n\r\n"


@pytest.fixture
def follow(served: tuple[Api, str]) -> Iterator[Callable[..., socket.socket]]:
    """Open a stream and return its connection once it has begun, or was refused."""
    where = urlsplit(served[1])
    with ExitStack() as opened:

        def one(fleet: UUID, headers: dict[str, str]) -> socket.socket:
            lines = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
            connection = opened.enter_context(socket.create_connection((where.hostname, where.port)))
            connection.settimeout(PATIENCE_S)
            connection.sendall(f"GET /v1/fleets/{fleet}/events HTTP/1.1\r\nHost: a\r\n{lines}\r\n".encode())
            return connection

        yield one


def begins(stream: socket.socket) -> str:
    """Its first event, read; or its refusal."""
    found = b""
    while b'"fleet"' not in found and b'"code"' not in found:
        piece = stream.recv(65536)
        assert piece
        found += piece
    return found.decode()


def ends(stream: socket.socket) -> float:
    """Seconds until it is over."""
    began, found = time.monotonic(), b""
    while not found.endswith(END):
        piece = stream.recv(65536)
        assert piece
        found += piece
    return time.monotonic() - began


def has_ended(stream: socket.socket) -> bool:
    stream.setblocking(False)
    try:
        return stream.recv(65536).endswith(END)
    except BlockingIOError:
        return False
    finally:
        stream.settimeout(PATIENCE_S)


def session_of(api: Api, actor: Actor) -> str:
    secret = new_secret()
    with api.database.writing() as session:
        later = utc_now() + timedelta(days=365)
        session.add(BrowserSession(secret_hash=secret_hash(secret), person_id=actor.person_id, expires_at=later))
    return secret


def taken_out(api: Api, fleet: UUID, actor: Actor) -> None:
    assert api.owner().delete(f"/fleets/{fleet}/members/{actor.person_id}").status_code == 204


def given_another_role(api: Api, fleet: UUID, actor: Actor) -> None:
    assert api.owner().patch(f"/fleets/{fleet}/members/{actor.person_id}", {"role": "viewer"}).status_code == 200


def token_revoked(api: Api, fleet: UUID, actor: Actor) -> None:
    with api.database.writing() as session:
        session.execute(update(ApiToken).where(ApiToken.person_id == actor.person_id).values(revoked_at=utc_now()))


@pytest.mark.parametrize("what", [taken_out, given_another_role, token_revoked])
def test_a_stream_ends_with_the_right_to_follow(served, follow, what: Callable[[Api, UUID, Actor], None]) -> None:
    api, _ = served
    fleet = api.fleet()
    staying, *leaving = (api.member(fleet, "annotator") for _ in range(3))
    stays, *streams = (follow(fleet, one.headers) for one in (staying, *leaving))
    for stream in (stays, *streams):
        assert "200 OK" in begins(stream)
    # Each end needs a look at all streams. The second end comes of a look after that of the first.
    for one, stream in zip(leaving, streams, strict=True):
        what(api, fleet, one)
        assert ends(stream) < PATIENCE_S
    assert not has_ended(stays)


def test_a_stream_ends_with_the_session(served, follow, fleet, viewer) -> None:
    api, _ = served
    cookie = {"Cookie": f"apexcal_session={session_of(api, viewer)}"}
    stream = follow(fleet, cookie)
    assert "200 OK" in begins(stream)
    assert api.client.post("/v1/sign-out", headers={**cookie, "Origin": "http://127.0.0.1:8000"}).status_code == 204
    assert ends(stream) < PATIENCE_S


def test_many_streams_cost_one_subscription_and_no_connection_of_the_database(served, follow, broker: Broker) -> None:
    api, _ = served
    fleet = api.fleet()
    people = [api.member(fleet, "viewer") for _ in range(3)]
    with broker.client() as client:
        before = len(client.client_list())
        streams = [follow(fleet, one.headers) for one in people for _ in range(fanout.STREAMS_OF_A_PERSON)]
        for stream in streams:
            assert "200 OK" in begins(stream)
        assert len(client.client_list()) <= before + 1
    # A look at who may still follow takes one for a moment.
    wait_until(lambda: api.database.engine.pool.checkedout() == 0, "no connection of the database in use")
    assert not any(has_ended(stream) for stream in streams)


def test_a_persons_oldest_stream_gives_way(served, follow, fleet) -> None:
    api, _ = served
    busy, other = api.member(fleet, "viewer"), api.member(fleet, "viewer")
    undisturbed = follow(fleet, other.headers)
    assert "200 OK" in begins(undisturbed)
    streams = []
    for _ in range(fanout.STREAMS_OF_A_PERSON + 3):
        streams.append(follow(fleet, busy.headers))
        assert "200 OK" in begins(streams[-1])
    for stream in streams[:3]:
        assert ends(stream) < PATIENCE_S
    assert not any(has_ended(stream) for stream in (*streams[3:], undisturbed))


def test_a_full_process_says_so(served, follow, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fanout, "STREAMS_OF_A_PROCESS", 2)
    api, _ = served
    fleet = api.fleet()
    for _ in range(2):
        assert "200 OK" in begins(follow(fleet, api.member(fleet, "viewer").headers))
    refused = begins(follow(fleet, api.member(fleet, "viewer").headers))
    assert "503" in refused and "too_many_streams" in refused and "retry-after: 60" in refused.lower()


def test_who_does_not_listen_is_told_to_read_anew(api: Api) -> None:
    with api.database.reading() as session:
        person = session.get(Person, api.owner().person_id)
    fleet = api.fleet()
    follower = Follower(Identity(person, {}, ""), fleet, "viewer")
    for number in range(101):
        follower.tell(Hint(fleet, "job", str(number)))
    follower.tell(Hint(fleet, "job", "last"))

    async def heard() -> list[Hint | None]:
        return [one async for one in follower.hints(0.1, 1.0)]

    assert asyncio.run(heard()) == [anything(fleet), Hint(fleet, "job", "last"), None]
    follower.tell(Hint(fleet, "job", "unheard"))
    follower.end()
    assert asyncio.run(heard()) == []


def test_who_leaves_at_once_is_no_fault(served, follow, caplog: pytest.LogCaptureFixture) -> None:
    """Also where the stream has given way meanwhile, so that more waits for its client than the first event."""
    api, _ = served
    fleet = api.fleet()
    hasty, staying = api.member(fleet, "viewer"), api.member(fleet, "viewer")
    for _ in range(3):
        leaving = [follow(fleet, hasty.headers) for _ in range(2 * fanout.STREAMS_OF_A_PERSON)]
        for stream in leaving:
            stream.close()
    assert "200 OK" in begins(follow(fleet, staying.headers))
    wait_until(lambda: len(api.app.state.fanout._followers) == 1, "the end of all streams that were left")
    assert [record.getMessage() for record in caplog.records if record.levelname == "ERROR"] == []
