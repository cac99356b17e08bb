"""Connections with deadlines and a limit on their number: uvicorn's protocol by itself waits for clients for ever.

``uvicorn --http service.platform.http.connections:PatientProtocol``. A proxy must limit addresses, and clients that
take their answers slowly; the kernel ends connections whose clients take nothing at all.
"""

from __future__ import annotations

import asyncio
import resource
import socket
import sys
from collections.abc import Callable

import httptools
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from service.platform.settings import get_settings

# Apache's mod_reqtimeout gives the head of a request 20 s, and asks for 500 bytes a second.
HEAD_S = 20.0
_BYTES_PER_S = 500
# As nginx: 60 s for the next bytes of a body, because bad networks pause.
WINDOW_S = 60.0
# Most bytes without progress: of a head, trailers, a chunk's extension, or empty lines. llhttp has no limit; h11 has
# 16 KiB.
_LONGEST_HEAD = 64 * 1024
# Most requests that wait on one connection. Each takes a kilobyte, and 28 bytes may be one.
_MOST_PIPELINED = 100
# How long sent bytes may stay unacknowledged by the peer (tcp(7), TCP_USER_TIMEOUT; Linux counts a closed window
# since 5.11).
_UNTAKEN_MS = 60_000
# Files that a process opens besides connections: database, broker, objects in transit.
_OTHER_FILES = 256


class PatientProtocol(HttpToolsProtocol):
    """One connection, which waits for its client's head or body, but not for ever."""

    since = 0.0
    _in_head = True
    _arrived = _unused = 0
    _moved = False
    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take the connection; if there are too many, end an idle one."""
        super().connection_made(transport)
        peer: socket.socket | None = transport.get_extra_info("socket")
        if peer is not None and peer.family != socket.AF_UNIX and hasattr(socket, "TCP_USER_TIMEOUT"):
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNTAKEN_MS)
        self.since = self.loop.time()
        self._wait(HEAD_S, self._end)
        self._end_surplus()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        super().connection_lost(exc)
        self._stop_waiting()

    def data_received(self, data: bytes) -> None:
        """Go on with the request."""
        self._arrived += len(data)
        self._moved = False
        self._unset_keepalive_if_required()
        try:
            self._feed(data)
        except httptools.HttpParserError:
            self.send_400_response("Invalid HTTP request received.")
            return
        self._unused = 0 if self._moved else self._unused + len(data)
        if self._unused > _LONGEST_HEAD:
            self.send_400_response("The request's head is too long.")
        elif self._in_head and self.is_idle and self._deadline is None:
            self._wait(HEAD_S, self._end)

    def on_header(self, name: bytes, value: bytes) -> None:
        """Note a header. Trailers after a body are ignored: the request is under way without them."""
        if self._in_head:
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Serve the request, and wait for its body."""
        assert self.parser is not None
        if self.parser.should_upgrade():
            return
        if len(self.pipeline) >= _MOST_PIPELINED:
            raise ValueError("too many requests at once")
        super().on_headers_complete()
        self._in_head, self._moved = False, True
        self._wait_for_body()

    def on_body(self, body: bytes) -> None:
        """Bytes of the body came."""
        self._moved = True
        super().on_body(body)

    def on_message_complete(self) -> None:
        """The request is complete: now the client waits."""
        assert self.parser is not None
        if self.parser.should_upgrade():
            return
        super().on_message_complete()
        self._in_head = self._moved = True
        self._stop_waiting()

    def on_response_complete(self) -> None:
        """Wait for the rest of the next head, if it has begun; uvicorn ends what stays idle."""
        super().on_response_complete()
        self.since = self.loop.time()
        if self._in_head and self._unused and self.is_idle:
            self._wait(HEAD_S, self._end)

    @property
    def is_idle(self) -> bool:
        """Whether no request is under way."""
        return self.cycle is None or self.cycle.response_complete

    def _feed(self, data: bytes) -> None:
        """Parse. Raises httptools' HttpParserError.

        After a head with `Upgrade`, llhttp expects another protocol, and the body would become the next request.
        Nothing is upgraded here, so such a head is parsed again without that header (RFC 9110, 7.8).
        """
        rest = memoryview(data)
        while True:
            assert self.parser is not None
            try:
                self.parser.feed_data(rest)
            except httptools.HttpParserUpgrade as upgrade:
                rest = rest[upgrade.args[0] :]
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

    def _wait_for_body(self) -> None:
        self._arrived = 0
        self._wait(WINDOW_S, self._check_body)

    def _check_body(self) -> None:
        # If the service itself does not read, or has not asked the client to send, the client is not slow.
        is_awaited = not self.flow.read_paused and not self.cycle.waiting_for_100_continue
        if is_awaited and self._arrived < WINDOW_S * _BYTES_PER_S:
            self._end()
        else:
            self._wait_for_body()

    def _wait(self, seconds: float, then: Callable[[], None]) -> None:
        self._stop_waiting()
        self._deadline = self.loop.call_later(seconds, then)

    def _stop_waiting(self) -> None:
        if self._deadline:
            self._deadline.cancel()
        self._deadline = None

    def _end(self) -> None:
        self._stop_waiting()
        self.transport.abort()

    def _end_surplus(self) -> None:
        """If there are too many connections, end the one that was idle longest, or this one if none is idle."""
        protocols = [each for each in self.connections if isinstance(each, PatientProtocol)]
        living = [each for each in protocols if not each.transport.is_closing()]
        if len(living) > min(get_settings().connections, _most_files()):
            idle = [each for each in living if each.is_idle and each is not self]
            min(idle, key=lambda each: each.since, default=self)._end()


def _most_files() -> int:
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return sys.maxsize if soft == resource.RLIM_INFINITY else max(soft - _OTHER_FILES, 64)
