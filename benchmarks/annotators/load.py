"""Annotators, open pages and a bystander, each a connection that stays open.

``python -m benchmarks.annotators.load`` reads a plan as JSON from standard input and prints what it measured as JSON.
It is a process of its own, so that what it does with its time is not the service's. An annotator asks as the page
does: the progress once, then tasks with two ahead and the answer, which has the progress; between answers they think.
A page follows the fleet's events and reads the progress again after a hint of the marking, once a second at most.
"""

from __future__ import annotations

import asyncio
import json
import random
import sys
import time
from collections import Counter, defaultdict
from collections.abc import AsyncIterator
from typing import Any
from uuid import UUID

_AHEAD = 2
_PAUSE_S = 0.1


class Connection:
    """One person's connection to the API."""

    def __init__(self, load: Load, token: str) -> None:
        self._load = load
        self._token = token

    async def open(self) -> None:
        """Connect."""
        self._reader, self._writer = await asyncio.open_connection("127.0.0.1", self._load.plan["port"])

    async def ask(self, name: str, method: str, path: str, body: Any = None) -> tuple[int, Any]:
        """Status and document of an answer; its milliseconds are noted under ``name``."""
        began = time.perf_counter()
        self.send(method, path, body)
        status, headers = await self._head()
        text = await self._reader.readexactly(int(headers.get("content-length", "0")))
        self._load.ms[name].append(1000.0 * (time.perf_counter() - began))
        self._load.statuses[status] += 1
        return status, json.loads(text) if text and status < 500 else None

    def send(self, method: str, path: str, body: Any = None) -> None:
        """Send a request."""
        content = b"" if body is None else json.dumps(body).encode()
        head = f"{method} /v1{path} HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer {self._token}\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(content)}\r\n\r\n"
        self._writer.write(head.encode() + content)

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


class Load:
    """One run."""

    def __init__(self, plan: dict[str, Any]) -> None:
        self.plan = plan
        self.ms: dict[str, list[float]] = defaultdict(list)
        self.statuses: Counter[int] = Counter()
        self.seconds = 0.0
        self.accepted = 0
        self._draw = random.Random(plan["seed"])
        self._end = 0.0

    async def run(self) -> None:
        """Mark until the time is over, or until nothing is left for anybody."""
        plan, began = self.plan, time.perf_counter()
        self._end = began + plan["seconds"]
        aside = [asyncio.create_task(self._page(token)) for token in plan["pages"]]
        aside.append(asyncio.create_task(self._bystander(plan["bystander"])))
        await asyncio.gather(*(self._annotate(token) for token in plan["annotators"]))
        self.seconds = time.perf_counter() - began
        for task in aside:
            task.cancel()
        ended = await asyncio.gather(*aside, return_exceptions=True)
        broken = [one for one in ended if one and not isinstance(one, asyncio.CancelledError)]
        if broken:
            raise RuntimeError(f"pages or the bystander ended: {broken}")

    async def _annotate(self, token: str) -> None:
        person, detection = Connection(self, token), f"/detections/{self.plan['detection']}"
        progress = f"{detection}/progress?camera=front"
        await person.open()
        await person.ask("progress", "GET", progress)
        await self._think()
        wanted = {"camera": "front", "ahead": _AHEAD}
        while True:
            status, task = await person.ask("take", "POST", f"{detection}/tasks/next", wanted)
            if status == 204 or time.perf_counter() > self._end:
                return
            await self._think()
            if status != 200:
                continue
            answer = {
                "id": str(UUID(int=self._draw.getrandbits(128), version=4)),
                "version": task["own"]["version"],
                "verdict": "confirmed",
                "mark": {"u": 100.0 * self._draw.random(), "v": 100.0 * self._draw.random()},
            }
            status, taken = await person.ask("answer", "POST", f"/tasks/{task['task_id']}/answer", answer)
            self.accepted += status == 200
            if status != 200 or taken["progress"] is None:
                await person.ask("progress", "GET", progress)

    async def _think(self) -> None:
        await asyncio.sleep(self._draw.uniform(*self.plan["think_s"]))

    async def _page(self, token: str) -> None:
        stream, page, detection = Connection(self, token), Connection(self, token), self.plan["detection"]
        await asyncio.gather(stream.open(), page.open())
        progress = f"/detections/{detection}/progress?camera=front"
        hinted = asyncio.Event()

        async def read() -> None:
            last = -1.0
            while True:
                await hinted.wait()
                settle, now = self._draw.uniform(0.15, 1.0), time.monotonic()
                await asyncio.sleep(max(settle, last + 1.0 - now))
                hinted.clear()
                last = time.monotonic()
                await page.ask("page", "GET", progress)

        reading = asyncio.create_task(read())
        try:
            stream.send("GET", f"/fleets/{self.plan['fleet']}/events")
            async for line in stream.events():
                if b'"marking"' in line:
                    hinted.set()
                if reading.done():
                    reading.result()
        finally:
            reading.cancel()

    async def _bystander(self, token: str) -> None:
        person = Connection(self, token)
        await person.open()
        while True:
            await person.ask("bystander", "GET", "/recordings?limit=10")
            await asyncio.sleep(_PAUSE_S)


def main() -> None:
    """Run and print."""
    load = Load(json.load(sys.stdin))
    asyncio.run(load.run())
    print(json.dumps({"seconds": load.seconds, "accepted": load.accepted, "ms": load.ms, "statuses": load.statuses}))


if __name__ == "__main__":
    main()
