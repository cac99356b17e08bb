"""No byte of a stranger's body is read, on any route; nobody's body is read beyond what its route takes."""

import asyncio
import select
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from urllib.parse import urlsplit
from uuid import UUID

import httpx
import pytest

from service.platform.auth import access
from service.platform.auth.credential_actions import new_secret
from service.platform.auth.gate import Gate
from service.platform.http.router import DOCUMENT
from tests.service.platform.auth.test_every_route import OPEN, address, fill, routes
from tests.support.databases import one_database
from tests.support.people import Actor, Api
from tests.support.processes import wait_until
from tests.support.uploads import digest, new_recording

pytestmark = one_database

PIECE = 32 * 1024
# What takes more than a document: imported pairs, and parts of uploads, which settings limit.
LARGE = ("/rigs/{rig_id}/correspondence-sets", "/recordings/{id}/parts/{number}")
ORIGIN = "http://127.0.0.1:8000"


class Exchange:
    """A request straight to the application, whose body is made as it is asked for, and what is answered."""

    def __init__(self, api: Api, method: str, path: str, headers: dict[str, str], pieces: Iterator[bytes]) -> None:
        self.taken = 0
        self.status = 0
        self._pieces = pieces
        path, _, query = path.partition("?")
        scope = {"type": "http", "http_version": "1.1", "method": method.upper(), "path": path, "scheme": "http"}
        scope |= {"raw_path": path.encode(), "query_string": query.encode(), "root_path": "", "asgi": {}}
        scope |= {"server": ("127.0.0.1", 8000), "client": ("127.0.0.1", 9)}
        named = {name.lower(): value for name, value in headers.items()}
        named = {"host": "127.0.0.1:8000", "content-type": "application/json", **named}
        scope["headers"] = [(name.encode(), value.encode()) for name, value in named.items()]
        asyncio.run(asyncio.wait_for(api.app(scope, self._receive, self._send), 20))

    async def _receive(self) -> dict:
        piece = next(self._pieces, None)
        if piece is None:
            return {"type": "http.disconnect"}
        self.taken += len(piece)
        return {"type": "http.request", "body": piece, "more_body": True}

    async def _send(self, message: dict) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]


def untouchable() -> Iterator[bytes]:
    raise AssertionError("the body was asked for")
    yield b""


def endless() -> Iterator[bytes]:
    yield b"["
    while True:
        yield b'{"":[]},' * (PIECE // 8)


def filled(api: Api, fleet: UUID) -> dict[str, str]:
    api.member(fleet, "admin")
    with api.database.writing() as session:
        return fill(session, fleet)


def unsafe() -> list[tuple[str, str]]:
    found = [(method, path) for method, path, _ in routes() if method != "get" and (method, path) not in OPEN]
    assert len(found) > 20
    return found


STRANGERS: dict[str, Callable[[], dict[str, str]]] = {
    "nobody": dict,
    "an unknown token": lambda: {"Authorization": f"Bearer {new_secret('apx_')}"},
    "a password": lambda: {"Authorization": "Basic YTpi"},
    "an ended session": lambda: {"Cookie": f"apexcal_session={new_secret()}", "Origin": ORIGIN},
}


@pytest.mark.parametrize("stranger", STRANGERS)
def test_no_route_reads_the_body_of_a_stranger(api: Api, stranger: str) -> None:
    rows = filled(api, api.fleet())
    for method, path in unsafe():
        for more in ({}, {"Content-Length": "33554432"}, {"Idempotency-Key": "a"}):
            answer = Exchange(api, method, address(path, rows), STRANGERS[stranger]() | more, untouchable())
            assert answer.status == 401, (method, path)


def test_a_page_of_another_site_is_refused_before_its_body(api: Api) -> None:
    headers = {"Cookie": f"apexcal_session={new_secret()}", "Origin": "http://elsewhere.example"}
    assert Exchange(api, "post", "/v1/fleets", headers, untouchable()).status == 403


def test_a_low_role_and_another_fleet_are_refused_before_a_large_body(api: Api) -> None:
    fleet = api.fleet()
    rows = filled(api, fleet)
    viewer, outsider = api.member(fleet, "viewer"), api.member(api.fleet(), "admin")
    for method, path in (("post", LARGE[0]), ("put", LARGE[1])):
        where = address(f"/v1{path}", rows) + ("?camera=front" if method == "post" else "")
        for who, status in ((viewer, 403), (outsider, 404)):
            headers = {**who.headers, "Content-Digest": digest(b"x")}
            assert Exchange(api, method, where, headers, untouchable()).status == status, (path, status)


def test_no_route_reads_more_than_it_takes(api: Api) -> None:
    fleet = api.fleet()
    rows = filled(api, fleet)
    admin = api.member(fleet, "admin")
    for method, path in unsafe():
        if path.endswith(LARGE):
            continue
        answer = Exchange(api, method, address(path, rows), {**admin.headers, "Idempotency-Key": "a"}, endless())
        assert answer.taken <= DOCUMENT + PIECE, (method, path, answer.taken)
        assert answer.taken == 0 or answer.status == 413, (method, path, answer.status)
        declared = admin.headers | {"Content-Length": str(DOCUMENT + 1), "Idempotency-Key": "a"}
        assert Exchange(api, method, address(path, rows), declared, untouchable()).status >= 400, (method, path)


def test_who_signs_in_sends_little(api: Api) -> None:
    answer = Exchange(api, "post", "/v1/sign-in", {}, endless())
    assert answer.status == 413 and answer.taken <= 2 * PIECE
    assert Exchange(api, "post", "/v1/sign-in", {"Content-Length": "5000"}, untouchable()).status == 413


def test_pairs_are_bounded_too(api: Api) -> None:
    fleet = api.fleet()
    rows = filled(api, fleet)
    where = address(f"/v1{LARGE[0]}", rows) + "?camera=front"
    engineer = api.member(fleet, "engineer").headers
    assert Exchange(api, "post", where, engineer | {"Content-Length": "33554433"}, untouchable()).status == 413
    assert Exchange(api, "post", where, engineer | {"Content-Type": "text/html"}, untouchable()).status == 415
    answer = Exchange(api, "post", where, engineer, endless())
    assert answer.status == 413 and answer.taken <= 33554432 + PIECE


def test_nobody_holds_all_connections_with_slow_bodies(served: tuple[Api, str]) -> None:
    api, url = served
    fleet = api.fleet()
    slow, other = api.member(fleet, "engineer"), api.member(fleet, "engineer")
    where = f"POST /v1/fleets/{fleet}/vehicles"
    with ExitStack() as opened:
        sending = [opened.enter_context(begun(url, slow, where, b'{"name": "van"}')) for _ in range(100)]

        def refused() -> int:
            return sum(b" 429 " in said and b"too_many_at_once" in said for said in answered(sending).values())

        wait_until(lambda: refused() == 36, "the refusal of those beyond 64")
        assert len(answered(sending)) == 36
        for who, status in ((slow, 429), (other, 201)):
            said = httpx.post(f"{url}/v1/fleets/{fleet}/vehicles", json={"name": "van"}, headers=who.headers)
            assert said.status_code == status
    wait_until(lambda: slow.post(f"/fleets/{fleet}/vehicles", {"name": "car"}).status_code == 201, "room again")


def test_who_is_taken_out_while_a_body_comes_does_nothing_more(
    served: tuple[Api, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(access, "FRESH_S", 0.0)
    api, url = served
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    recording = new_recording(engineer, fleet)
    pairs = b'{"pairs": [{"x": 1, "y": 1, "z": 1, "u": 1, "v": 1}]}'
    bodies = {
        f"POST /v1/fleets/{fleet}/vehicles": b'{"name": "car"}',
        f"PUT /v1/recordings/{recording['id']}/parts/1": b"abc",
        f"POST /v1/rigs/{recording['rig_id']}/correspondence-sets?camera=front": pairs,
    }
    with ExitStack() as opened:
        sending = {
            opened.enter_context(begun(url, engineer, where, body)): body[1:] for where, body in bodies.items()
        }
        # It is known who asks: each of them waits for the rest of its body.
        wait_until(lambda: _under_way(api, engineer) == len(sending), "the requests")
        assert api.owner().delete(f"/fleets/{fleet}/members/{engineer.person_id}").status_code == 204
        for connection, rest in sending.items():
            connection.sendall(rest)
        wait_until(lambda: len(answered(list(sending))) == len(sending), "an answer to each")
        assert [said[9:12] for said in answered(list(sending)).values()] == [b"404"] * len(sending)


def _under_way(api: Api, who: Actor) -> int:
    """How many requests of a person wait for their body or are worked on."""
    gate = api.app.router.middleware_stack
    assert isinstance(gate, Gate)
    return gate._under_way[who.person_id]


def begun(url: str, who: Actor, request: str, body: bytes) -> socket.socket:
    """A connection with a request of whose body one byte came."""
    where = urlsplit(url)
    connection = socket.create_connection((where.hostname, where.port))
    headers = {**who.headers, "Host": "a", "Content-Type": "application/json", "Content-Length": len(body)}
    headers["Content-Digest"] = digest(body)
    lines = [f"{request} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items()), "", ""]
    connection.sendall("\r\n".join(lines).encode() + body[:1])
    return connection


def answered(connections: list[socket.socket]) -> dict[socket.socket, bytes]:
    ready, _, _ = select.select(connections, [], [], 0)
    return {one: one.recv(65536, socket.MSG_PEEK) for one in ready}
