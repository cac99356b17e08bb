"""A connection to the API that stays open: little work besides the service's own."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any


class Connection:
    """One person's connection to an API on this machine."""

    def __init__(self, port: int, token: str) -> None:
        self._port, self._token = port, token

    async def open(self) -> None:
        """Connect."""
        self._reader, self._writer = await asyncio.open_connection("127.0.0.1", self._port)

    async def ask(self, method: str, path: str, body: Any = None, etag: str = "") -> tuple[int, bytes]:
        """Status and body of an answer."""
        self.send(method, path, body, etag)
        status, headers = await self._head()
        length = 0 if status in (204, 304) else int(headers.get("content-length", "0"))
        return status, await self._reader.readexactly(length)

    def send(self, method: str, path: str, body: Any = None, etag: str = "") -> None:
        """Send a request."""
        content = b"" if body is None else json.dumps(body).encode()
        head = f"{method} /v1{path} HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer {self._token}\r\n"
        if body is not None:
            head += f"Content-Type: application/json\r\nContent-Length: {len(content)}\r\n"
        if etag:
            head += f"If-None-Match: {etag}\r\n"
        self._writer.write(f"{head}\r\n".encode() + content)

    async def events(self) -> AsyncIterator[bytes]:
        """Each line of an answer without end."""
        await self._head()
        while line := await self._reader.readline():
            yield line

    async def _head(self) -> tuple[int, dict[str, str]]:
        head = (await self._reader.readuntil(b"\r\n\r\n")).decode()
        first, *lines = head.strip().split("\r\n")
        headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        return int(first[9:12]), headers
