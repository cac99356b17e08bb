"""Connections with deadlines and a limit: uvicorn's protocol, which by itself waits for its clients for ever.

``uvicorn --http service.platform.http.connections:PatientProtocol``. A proxy in front does the same and more; this is
what the service withstands without one. Slow is allowed, silent is not: a body or answer takes as long as it moves.
"""

from __future__ import annotations

import asyncio
import resource
import socket
import sys
from array import array
from collections.abc import Callable, Iterable
from contextlib import suppress
from fcntl import ioctl
from ipaddress import ip_address, ip_network
from termios import TIOCOUTQ
from typing import Literal

import httptools
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from service.platform.settings import get_settings

# Apache's mod_reqtimeout gives the head of a request 20 s, and asks for 500 bytes a second.
HEAD_S = 20.0
_BYTES_PER_S = 500
# Bytes that bring a request no further: of a head that is not complete, of a chunk's extension, of trailers, of empty
# lines between requests. llhttp has no limit; h11, which was used before, took 16 KiB.
_LONGEST_HEAD = 16 * 1024
# Requests that came before the first of them was answered. Each takes a kilobyte, and 28 bytes may be one.
_MOST_PIPELINED = 100
# As nginx: 60 s for the next bytes of a body, and for a client that takes none of an answer. Bad lines pause.
WINDOW_S = 60.0
# For the rest of a body that was answered already, such as a part from somebody who is not signed in.
UNWANTED_S = 5.0
# A peer that vanished acknowledges nothing, such as the pings of an event stream every 15 s.
_VANISHED_MS = 60_000
# What a process opens beside connections: database, broker, objects in transit.
_OTHER_FILES = 256

# What the client sends next, or waits for.
_Expected = Literal["head", "body", "answer"]


class PatientProtocol(HttpToolsProtocol):
    """One connection. At each moment it waits for one thing of its client at most, and not for ever."""

    since = 0.0
    _origin: str | None = None
    _reading: asyncio.TimerHandle | None = None
    _writing: asyncio.TimerHandle | None = None
    _arrived = 0
    _unsent = 0
    _expected: _Expected = "head"
    _idle_bytes = 0
    _moved = False

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take the connection; where it is one too many, end one that has asked for nothing."""
        super().connection_made(transport)
        # So the protocol is told of each byte that the client does not take, and adds none meanwhile.
        transport.set_write_buffer_limits(high=0)
        _notice_the_vanished(transport)
        self._origin = _origin(self.client)
        self.since = self.loop.time()
        self._wait_for_head()
        self._make_room()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        super().connection_lost(exc)
        self._stop_waiting()
        self._stop_writing()

    def data_received(self, data: bytes) -> None:
        """Go on with the request, and see what is waited for now."""
        before = self._expected
        self._arrived += len(data)
        self._moved = False
        self._unset_keepalive_if_required()
        try:
            self._feed(data)
        except httptools.HttpParserError:
            self._refuse("Invalid HTTP request received.")
            return
        if self.transport.is_closing():
            return
        self._idle_bytes = 0 if self._moved else self._idle_bytes + len(data)
        if self._idle_bytes > _LONGEST_HEAD:
            self._refuse("The request's head is too long.")
            return
        self._check_request(before)

    def on_message_begin(self) -> None:
        """A request begins."""
        super().on_message_begin()
        self._go_to("head")

    def on_header(self, name: bytes, value: bytes) -> None:
        """Note a header. What comes after a body is none: the request was judged without it."""
        if self._expected == "head":
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Serve the request. Raises ValueError, which becomes 400, where it does not name one host (RFC 9112)."""
        assert self.parser is not None
        if self.parser.should_upgrade():
            return
        hosts = sum(name == b"host" for name, _ in self.headers)
        http_version = self.parser.get_http_version()
        if http_version not in ("1.0", "1.1"):
            raise ValueError(f"HTTP/{http_version}")
        if hosts > 1 or (hosts == 0 and http_version == "1.1"):
            raise ValueError(f"{hosts} Host headers")
        if len(self.pipeline) >= _MOST_PIPELINED:
            raise ValueError("too many requests at once")
        super().on_headers_complete()
        self._go_to("body")

    def on_body(self, body: bytes) -> None:
        """Bytes of the body came."""
        self._moved = True
        super().on_body(body)

    def on_message_complete(self) -> None:
        """The request is complete."""
        assert self.parser is not None
        if self.parser.should_upgrade():
            return
        super().on_message_complete()
        self._go_to("answer")

    def on_response_complete(self) -> None:
        """Wait for the next request; not for long where this one's body is still coming."""
        super().on_response_complete()
        self.since = self.loop.time()
        if self._expected != "body":  # uvicorn ends what stays idle
            self._stop_waiting()
        elif self.is_idle:
            self._wait(UNWANTED_S, self._end)
        else:  # the next request's: it came with this one
            self._wait_for_body()

    def pause_writing(self) -> None:
        """The client takes no more at the moment: see in a while that it went on."""
        super().pause_writing()
        self._stop_writing()
        self._unsent = self._not_taken()
        self._writing = self.loop.call_later(WINDOW_S, self._check_writing)

    def resume_writing(self) -> None:
        """The client took all that there was."""
        super().resume_writing()
        self._stop_writing()

    @property
    def is_idle(self) -> bool:
        """Whether nothing is asked for: no head of a request is complete, or all are answered."""
        return self.cycle is None or self.cycle.response_complete

    @property
    def is_stalled(self) -> bool:
        """Whether the client leaves its answer lying."""
        return self._writing is not None

    def _feed(self, data: bytes) -> None:
        """Parse. Raises httptools' HttpParserError.

        llhttp takes what follows a head with `Upgrade` for another protocol: the body would become the next request.
        Nothing is upgraded here, so such a head is parsed again without that header (RFC 9110, 7.8).
        """
        rest = memoryview(data)
        while True:
            assert self.parser is not None
            try:
                self.parser.feed_data(rest)
            except httptools.HttpParserUpgrade as found:
                rest = rest[found.args[0] :]
            else:
                return
            method, http_version = self.parser.get_method(), self.parser.get_http_version().encode()
            if method == b"CONNECT":
                raise httptools.HttpParserError("CONNECT")
            lines = [method + b" " + self.url + b" HTTP/" + http_version]
            lines += [name + b": " + value for name, value in self.headers if name != b"upgrade"]
            self.parser = httptools.HttpRequestParser(self)
            self.parser.set_dangerous_leniencies(lenient_data_after_close=True)
            self.parser.feed_data(b"\r\n".join([*lines, b"", b""]))

    def _go_to(self, expected: _Expected) -> None:
        self._expected, self._moved = expected, True

    def _refuse(self, message: str) -> None:
        self.logger.warning(message)
        self.send_400_response(message)

    def _check_request(self, before: _Expected) -> None:
        if self._expected == "answer":
            # Empty lines after an answer are no request.
            if not self.is_idle:
                self._stop_waiting()
            elif self._reading is None:
                self._wait_for_head()
        elif self._expected == "body":
            if before != "body":
                self._wait_for_body()
        elif before != "head" or self._reading is None:
            self._wait_for_head()

    def _check_head(self) -> None:
        # The beginning of the next request may have come with the one that is being answered.
        if self.is_idle:
            self._end()
        else:
            self._wait_for_head()

    def _check_body(self) -> None:
        # Where the service does not read, or has not told the client to send, the client is not slow.
        is_awaited = not self.flow.read_paused and not self.cycle.waiting_for_100_continue
        if is_awaited and self._arrived < WINDOW_S * _BYTES_PER_S:
            self._end()
        else:
            self._wait_for_body()

    def _check_writing(self) -> None:
        if self._unsent - self._not_taken() < WINDOW_S * _BYTES_PER_S:
            self._end()
        else:
            self.pause_writing()

    def _not_taken(self) -> int:
        """Bytes of the answer that the client has not acknowledged, here and in the kernel's buffer of megabytes."""
        in_kernel = array("i", [0])
        with suppress(OSError):
            ioctl(self.transport.get_extra_info("socket").fileno(), TIOCOUTQ, in_kernel)
        return self.transport.get_write_buffer_size() + in_kernel[0]

    def _wait_for_head(self) -> None:
        self._wait(HEAD_S, self._check_head)

    def _wait_for_body(self) -> None:
        self._arrived = 0
        self._wait(WINDOW_S, self._check_body)

    def _wait(self, seconds: float, then: Callable[[], None]) -> None:
        self._stop_waiting()
        self._reading = self.loop.call_later(seconds, then)

    def _stop_waiting(self) -> None:
        if self._reading:
            self._reading.cancel()
        self._reading = None

    def _stop_writing(self) -> None:
        if self._writing:
            self._writing.cancel()
        self._writing = None

    def _end(self) -> None:
        self._stop_waiting()
        self._stop_writing()
        self.transport.abort()

    def _make_room(self) -> None:
        settings = get_settings()
        here = (one for one in self.connections if isinstance(one, PatientProtocol))
        everybody = [one for one in here if not one.transport.is_closing()]
        neighbours = [one for one in everybody if self._origin is not None and one._origin == self._origin]
        if len(everybody) > min(settings.connections, _most_files()):
            self._end_one_of(everybody)
        elif len(neighbours) > settings.connections_per_address:
            self._end_one_of(neighbours)

    def _end_one_of(self, crowd: Iterable[PatientProtocol]) -> None:
        """End who has asked for nothing for longest, else who leaves an answer lying, else this connection."""
        others = [one for one in crowd if one is not self]
        idle = [one for one in others if one.is_idle] or [one for one in others if one.is_stalled]
        (min(idle, key=lambda one: one.since) if idle else self)._end()


def _origin(client: tuple[str, int] | None) -> str | None:
    """The address under which a connection is counted; None from this host, where a proxy brings everybody's."""
    if client is None:
        return None
    address = ip_address(client[0].partition("%")[0])
    if address.is_loopback:
        return None
    # One subscriber has 2^64 addresses of IPv6.
    return str(ip_network((address, 64), strict=False)) if address.version == 6 else str(address)


def _notice_the_vanished(transport: asyncio.Transport) -> None:
    found: socket.socket | None = transport.get_extra_info("socket")
    if found is not None and found.family != socket.AF_UNIX and hasattr(socket, "TCP_USER_TIMEOUT"):
        found.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _VANISHED_MS)


def _most_files() -> int:
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return sys.maxsize if soft == resource.RLIM_INFINITY else max(soft - _OTHER_FILES, 64)
