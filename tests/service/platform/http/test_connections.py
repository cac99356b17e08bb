"""Connections: who is silent is let go, who is slow is waited for, and who asks finds room."""

import hashlib
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest

from service.platform.auth import gate
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.http import connections
from service.platform.settings import get_settings
from tests.service.detections.seeding import seed_rig
from tests.support.databases import one_database
from tests.support.people import Api
from tests.support.processes import wait_until
from tests.support.uploads import digest, new_vehicle

pytestmark = one_database

# A deadline that passes by itself.
SHORT_S = 0.5
PATIENCE_S = 15.0


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Make some deadlines short, from now on: what must come first has the time that it has outside of tests."""

    def now(*names: str) -> None:
        for name in names:
            monkeypatch.setattr(connections, name, SHORT_S)
        monkeypatch.setattr(connections, "_BYTES_PER_S", 100 / SHORT_S)

    return now


class Windows:
    """Deadlines that pass when the test says so: what a client did before does not depend on how fast it was."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._connections: list[connections.PatientProtocol] = []
        for name in ("HEAD_S", "WINDOW_S"):
            monkeypatch.setattr(connections, name, 3600.0)
        monkeypatch.setattr(connections, "_BYTES_PER_S", 100 / 3600.0)
        made = connections.PatientProtocol.connection_made

        def note(protocol: connections.PatientProtocol, transport: Any) -> None:
            made(protocol, transport)
            self._connections.append(protocol)

        monkeypatch.setattr(connections.PatientProtocol, "connection_made", note)

    def of(self, client: socket.socket) -> connections.PatientProtocol:
        """The server's side of a connection."""

        def there() -> list[connections.PatientProtocol]:
            return [one for one in self._connections if one.client == client.getsockname()]

        wait_until(lambda: bool(there()), "the connection")
        return there()[0]

    def passes(
        self,
        client: socket.socket,
        check: Callable[[connections.PatientProtocol], None],
        when: Callable[[connections.PatientProtocol], bool] = lambda _: True,
    ) -> bool:
        """Let a deadline of a connection pass if something holds then; whether it did. All in the server's loop."""
        protocol, done = self.of(client), Future[bool]()

        def look() -> None:
            holds = when(protocol)
            if holds:
                check(protocol)
            done.set_result(holds)

        protocol.loop.call_soon_threadsafe(look)
        return done.result(PATIENCE_S)


def _has_a_piece(protocol: connections.PatientProtocol) -> bool:
    return protocol._arrived >= 100


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> Windows:
    return Windows(monkeypatch)


@pytest.fixture
def connect(served: tuple[Api, str]) -> Iterator[Callable[..., socket.socket]]:
    """Open a connection to the server and send the beginning of something."""
    where = urlsplit(served[1])
    with ExitStack() as opened:

        def one(data: bytes = b"", receive_buffer: int = 0) -> socket.socket:
            connection = opened.enter_context(socket.socket())
            if receive_buffer:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
            connection.settimeout(PATIENCE_S)
            connection.connect((where.hostname, where.port))
            connection.sendall(data)
            return connection

        yield one


def head(method: str, path: str, *lines: str) -> bytes:
    return "\r\n".join([f"{method} {path} HTTP/1.1", "Host: 127.0.0.1:8000", *lines, "", ""]).encode()


def all_of(connection: socket.socket) -> bytes:
    """What comes until the server ends the connection."""
    found = b""
    try:
        while piece := connection.recv(65536):
            found += piece
    except ConnectionResetError:
        pass
    return found


def until(connection: socket.socket, last: bytes) -> bytes:
    """An answer that ends so."""
    found = b""
    while not found.endswith(last):
        piece = connection.recv(65536)
        assert piece, found
        found += piece
    return found


def ended(connection: socket.socket) -> bool:
    """Whether the server has ended the connection; what it sent before is left out."""
    connection.setblocking(False)
    try:
        while connection.recv(65536):
            pass
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def test_who_says_nothing_or_half_of_a_head_is_let_go(impatient: Callable, connect: Callable) -> None:
    silent = [connect(head("GET", "/healthz"))]
    assert until(silent[0], b"}").startswith(b"HTTP/1.1 200")
    impatient("HEAD_S")
    silent[0].sendall(b"GET /healthz")
    silent += [connect(), connect(b"GET /healthz HTTP/1.1\r\nX-")]
    for one in silent:
        assert all_of(one) == b""


def test_a_head_that_comes_letter_by_letter_has_the_same_time(impatient: Callable, connect: Callable) -> None:
    impatient("HEAD_S")
    one = connect(b"GET /healthz HTTP/1.1\r\nX-Long: ")
    end = time.monotonic() + PATIENCE_S
    while not ended(one):
        assert time.monotonic() < end
        try:
            one.send(b"a")
        except OSError:
            break
        time.sleep(0.05)


def test_half_a_body_is_let_go_and_a_stranger_gets_the_answer_first(
    impatient: Callable, served: tuple[Api, str], connect: Callable
) -> None:
    impatient("WINDOW_S")
    api, _ = served
    lines = ("Content-Type: application/json", "Content-Length: 1000")
    stranger = connect(head("POST", "/v1/fleets", *lines) + b"{")
    assert all_of(stranger).startswith(b"HTTP/1.1 401")
    owner = connect(head("POST", "/v1/fleets", *lines, f"Authorization: Bearer {api.owner().token}") + b"{")
    assert all_of(owner) == b""


def test_an_upload_over_a_slow_line_goes_on_and_one_that_stops_does_not(
    windows: Windows, served: tuple[Api, str], connect: Callable
) -> None:
    api, _ = served
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    made = new_vehicle(engineer, fleet)
    asked = {"name": "drive", "file_name": "drive.bag", "rig_id": made["rig"]}
    recording = engineer.post(f"/vehicles/{made['vehicle']}/recordings", asked).json()["id"]
    # A window asks for one piece.
    pieces = [bytes([n]) * 100 for n in range(5)]
    lines = (f"Authorization: Bearer {engineer.token}", f"Content-Digest: {digest(b''.join(pieces))}")
    lines = (*lines, f"Content-Length: {len(b''.join(pieces))}")
    path = f"/v1/recordings/{recording}/parts/1"
    slow = connect(head("PUT", path, *lines))
    wait_until(lambda: not windows.of(slow)._in_head, "the head")
    for piece in pieces[:-1]:
        slow.sendall(piece)
        wait_until(lambda: windows.passes(slow, connections.PatientProtocol._check_body, _has_a_piece), "the piece")
    slow.sendall(pieces[-1])
    answer = until(slow, b"}")
    assert answer.startswith(b"HTTP/1.1 200"), answer
    assert hashlib.sha256(b"".join(pieces)).hexdigest().encode() in answer
    stopped = connect(head("PUT", path.replace("/1", "/2"), *lines))
    wait_until(lambda: not windows.of(stopped)._in_head, "the head")
    windows.passes(stopped, connections.PatientProtocol._check_body)
    assert all_of(stopped) == b""


def a_long_answer(api: Api) -> bytes:
    """A request for some 5 MB, more than the machine keeps for a client that takes nothing."""
    fleet = api.fleet()
    rig = seed_rig(api.database, fleet)
    values = [number + 0.123456789012 for number in range(60_000)]
    with api.database.writing() as session:
        row = CorrespondenceSet(fleet_id=fleet, vehicle_id=rig.vehicle_id, rig_id=rig.id, camera="front")
        row.source, row.content_hash, row.count = "import", "0", len(values)
        row.pairs = dict.fromkeys("xyzuv", values)
        session.add(row)
    viewer = api.member(fleet, "viewer")
    return head("GET", f"/v1/correspondence-sets/{row.id}", f"Authorization: Bearer {viewer.token}")


def test_who_leaves_an_answer_lying_is_let_go(
    served: tuple[Api, str], connect: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The end comes once nothing is taken for so long, whoever else takes theirs meanwhile."""
    api, _ = served
    monkeypatch.setattr(connections, "_UNTAKEN_MS", 2000)
    failed, lost = threading.Event(), connections.PatientProtocol.connection_lost

    def note(protocol: connections.PatientProtocol, error: Exception | None) -> None:
        lost(protocol, error)
        if error is not None:
            failed.set()

    monkeypatch.setattr(connections.PatientProtocol, "connection_lost", note)
    # Of two people: one has memory for one such answer.
    deaf = connect(a_long_answer(api), receive_buffer=32768)
    whole = until(connect(a_long_answer(api)), b"0\r\n\r\n")
    assert failed.wait(60)
    assert len(all_of(deaf)) < len(whole)


def test_silent_connections_never_fill_the_service(
    served: tuple[Api, str], connect: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    api, url = served
    fleet = api.fleet()
    viewer = api.member(fleet, "viewer")
    monkeypatch.setattr(connections, "HEAD_S", 60.0)  # only the limit may end them
    get_settings().connections = 20
    stream = connect(head("GET", f"/v1/fleets/{fleet}/events", f"Authorization: Bearer {viewer.token}"))
    assert b"200 OK" in stream.recv(65536)
    silent = [connect() for _ in range(100)]
    for _ in range(5):
        assert httpx.get(f"{url}/healthz", timeout=PATIENCE_S).json() == {"status": "ok"}
    wait_until(lambda: sum(not ended(one) for one in silent) <= 20, "room")
    assert not ended(stream), "who asked for something was let go"


def test_two_requests_at_once_are_both_answered(windows: Windows, served: tuple[Api, str], connect: Callable) -> None:
    """The second's body comes later than the first's answer."""
    api, _ = served
    body = json.dumps({"name": "pipelined"}).encode()
    lines = (f"Authorization: Bearer {api.owner().token}", "Content-Type: application/json", "Connection: close")
    second = head("POST", "/v1/fleets", *lines, f"Content-Length: {len(body)}")
    one = connect(head("GET", "/healthz") + second + body[:5])
    assert until(one, b"}").startswith(b"HTTP/1.1 200")
    one.sendall(body[5:])
    assert all_of(one).startswith(b"HTTP/1.1 201")


def test_a_head_that_is_too_long_is_refused(connect: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "HEAD_S", 60.0)  # only its length may end it
    endless = connect(b"GET /healthz HTTP/1.1\r\nHost: a\r\n")
    for _ in range(100):
        try:
            endless.sendall(b"X-Long: " + b"a" * 4096 + b"\r\n")
        except OSError:
            break
    answer = all_of(endless)
    assert answer == b"" or answer.startswith(b"HTTP/1.1 400")
    assert all_of(connect(b"GET /healthz HTTP/1.0\r\n\r\n")).startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize(
    "lines",
    [
        ("Content-Length: 5", "Transfer-Encoding: chunked"),
        ("Content-Length: 5", "Content-Length: 6"),
        ("Content-Length: +5",),
        ("Transfer-Encoding: chunked, identity",),
        ("Transfer-Encoding : chunked",),
        ("X: a\x00b",),
    ],
)
def test_a_request_whose_end_is_unclear_is_refused(connect: Callable, lines: tuple[str, ...]) -> None:
    """A proxy in front might see another request than we do."""
    answer = all_of(connect(head("POST", "/v1/sign-in", *lines) + b"hello"))
    assert answer.startswith(b"HTTP/1.1 400"), answer
    assert answer.count(b"HTTP/1.1") == 1


def test_the_next_head_may_begin_while_an_answer_is_under_way(
    impatient: Callable, windows: Windows, served: tuple[Api, str], connect: Callable
) -> None:
    api, _ = served
    stream = head("GET", f"/v1/fleets/{api.fleet()}/events", f"Authorization: Bearer {api.owner().token}")
    one = connect(stream + b"GET /heal")
    assert b"200 OK" in one.recv(65536)
    impatient("HEAD_S")
    one.sendall(b"t")
    wait_until(lambda: windows.of(one)._unused == 1, "the letter")
    assert windows.of(one)._deadline is None


@pytest.mark.parametrize("length", ["Content-Length: 53", "Transfer-Encoding: chunked"])
def test_the_body_of_a_request_that_offers_another_protocol_is_its_body(
    served: tuple[Api, str], connect: Callable, length: str
) -> None:
    """Not the next request, which a proxy in front would not have seen."""
    within = b"GET /healthz HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n"
    body = within if "53" in length else b"35\r\n" + within + b"\r\n0\r\n\r\n"
    offer = head("POST", "/v1/sign-in", "Connection: Upgrade", "Upgrade: h2c", length)
    one = connect(offer + body + head("GET", "/v1/unknown", "Connection: close"))
    answers = all_of(one)
    assert answers.count(b"HTTP/1.1 ") == 2 and b'{"status":"ok"}' not in answers
    # In a segment of its own, too.
    other = connect(offer)
    other.sendall(body + head("GET", "/v1/unknown", "Connection: close"))
    assert all_of(other).count(b"HTTP/1.1 ") == 2


def test_who_sends_empty_lines_after_an_answer_is_let_go(impatient: Callable, connect: Callable) -> None:
    one = connect(head("GET", "/healthz"))
    assert until(one, b"}").startswith(b"HTTP/1.1 200")
    impatient("HEAD_S")
    one.sendall(b"\r\n")
    assert all_of(one) == b""


@pytest.mark.parametrize("endless", [b"0\r\n" + b"X: a\r\n" * 50_000, b"5;" + b"a" * 300_000])
def test_what_comes_beside_a_body_is_not_endless(
    connect: Callable, monkeypatch: pytest.MonkeyPatch, endless: bytes
) -> None:
    monkeypatch.setattr(connections, "WINDOW_S", 60.0)
    one = connect(head("POST", "/v1/sign-in", "Content-Type: application/json", "Transfer-Encoding: chunked"))
    try:
        for start in range(0, len(endless), 4096):
            one.sendall(endless[start : start + 4096])
            time.sleep(0.001)
    except OSError:
        return
    assert all_of(one).startswith(b"HTTP/1.1 400")


def test_a_trailer_is_no_header(served: tuple[Api, str], connect: Callable) -> None:
    api, _ = served
    lines = ("Content-Type: application/json", "Transfer-Encoding: chunked", "Connection: close")
    trailer = f"Authorization: Bearer {api.owner().token}"
    answer = all_of(connect(head("POST", "/v1/fleets", *lines) + f"0\r\n{trailer}\r\n\r\n".encode()))
    assert answer.startswith(b"HTTP/1.1 401"), answer


def test_requests_that_come_together_are_answered_and_are_not_endless(windows: Windows, connect: Callable) -> None:
    padded = head("GET", "/healthz", "X-Padding: " + "a" * 400)
    last = head("GET", "/healthz", "Connection: close")
    # More bytes than a head may have, and the last head is not complete.
    some = connect(padded * 49 + last[:10])
    answers = b""
    while answers.count(b'{"status":"ok"}') < 49:
        answers += some.recv(65536)
    some.sendall(last[10:])
    assert (answers + all_of(some)).count(b"HTTP/1.1 200") == 50
    assert b"HTTP/1.1 400" in all_of(connect(padded * 500))


def unfinished_sign_in() -> bytes:
    return head("POST", "/v1/sign-in", "Content-Type: application/json", "Content-Length: 40") + b'{"link":'


def test_unfinished_sign_ins_end_also_where_others_come(
    served: tuple[Api, str], connect: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "WINDOW_S", 10 * PATIENCE_S)
    monkeypatch.setattr(gate, "STRANGER_S", 10 * PATIENCE_S)
    monkeypatch.setattr(gate, "STRANGERS", 4)
    several = [connect(unfinished_sign_in()) for _ in range(7)]
    wait_until(lambda: sum(map(ended, several)) == 3, "the end of those beyond four")
    assert httpx.get(f"{served[1]}/healthz", timeout=PATIENCE_S).status_code == 200
    monkeypatch.setattr(gate, "STRANGER_S", SHORT_S)
    answer = all_of(connect(unfinished_sign_in()))
    assert answer.startswith(b"HTTP/1.1 408") and b'"body_too_slow"' in answer
