"""Requests at a steady rate over connections that stay open, each timed from the moment when it was due.

``python -m benchmarks.retrieval.load PORT RATE SECONDS`` reads lines ``PATH TOKEN ETAG`` (``-`` for none) from
standard input, asks for one after the other, and prints one line of JSON: milliseconds, and answers by status. It is
a process of its own, so that what it does with its time is not the service's.
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections import Counter, deque

_CONNECTIONS = 64
# The first so many seconds fill caches and connections; what is asked later is measured.
_WARM_S = 2.0


class _Connection(asyncio.Protocol):
    def __init__(self, load: Load) -> None:
        self._load = load
        self._due = 0.0
        self._buffer = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def ask(self, request: bytes, due: float) -> None:
        self._due, self._buffer = due, b""
        self.transport.write(request)

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        head, end, body = self._buffer.partition(b"\r\n\r\n")
        if not end:
            return
        status = int(head[9:12])
        length = 0
        if status not in (204, 304):
            length = int(head.lower().partition(b"content-length:")[2].partition(b"\r\n")[0])
        if len(body) == length:
            self._load.answered(self, status, self._due)

    def connection_lost(self, exc: Exception | None) -> None:
        if not self._load.is_over:
            self._load.failures += 1


class Load:
    """One run."""

    def __init__(self, requests: list[bytes], rate: float, seconds: float) -> None:
        self._requests = requests
        self._rate = rate
        self._count = int(rate * (seconds + _WARM_S))
        self._idle: deque[_Connection] = deque()
        self._late: deque[tuple[bytes, float]] = deque()
        self._done = asyncio.Event()
        self._answers = 0
        self.failures = 0
        self.is_over = False
        self.ms: list[float] = []
        self.statuses: Counter[int] = Counter()

    async def run(self, port: int) -> None:
        """Send everything, and wait for the answers."""
        loop = self._loop = asyncio.get_running_loop()
        for _ in range(_CONNECTIONS):
            _, connection = await loop.create_connection(lambda: _Connection(self), "127.0.0.1", port)
            self._idle.append(connection)
        self._began = loop.time() + 0.1
        for number in range(self._count):
            due = self._began + number / self._rate
            if (wait := due - loop.time()) > 0:
                await asyncio.sleep(wait)
            elif number % 8 == 0:
                await asyncio.sleep(0)
            request = self._requests[number % len(self._requests)]
            if self._idle:
                self._idle.popleft().ask(request, due)
            else:
                self._late.append((request, due))
        await asyncio.wait_for(self._done.wait(), 60)
        self.is_over = True

    def answered(self, connection: _Connection, status: int, due: float) -> None:
        """Note an answer, and give the connection what waits for one."""
        if due - self._began >= _WARM_S:
            self.ms.append(1000.0 * (self._loop.time() - due))
            self.statuses[status] += 1
        self._answers += 1
        if self._answers == self._count:
            self._done.set()
        if self._late:
            connection.ask(*self._late.popleft())
        else:
            self._idle.append(connection)


def _request(line: str) -> bytes:
    path, token, etag = line.split()
    named = f"If-None-Match: {etag}\r\n" if etag != "-" else ""
    return f"GET {path} HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer {token}\r\n{named}\r\n".encode()


def main() -> None:
    """Run and print."""
    port, rate, seconds = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
    load = Load([_request(line) for line in sys.stdin], rate, seconds)
    asyncio.run(load.run(port))
    print(json.dumps({"ms": load.ms, "statuses": load.statuses, "failures": load.failures}))


if __name__ == "__main__":
    main()
