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
from typing import Any
from uuid import UUID

from benchmarks.connection import Connection

_AHEAD = 2
_PAUSE_S = 0.1


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

    async def _ask(self, person: Connection, name: str, method: str, path: str, body: Any = None) -> tuple[int, Any]:
        """Status and document of an answer; its milliseconds are noted under ``name``."""
        began = time.perf_counter()
        status, text = await person.ask(method, path, body)
        self.ms[name].append(1000.0 * (time.perf_counter() - began))
        self.statuses[status] += 1
        return status, json.loads(text) if text and status < 500 else None

    async def _annotate(self, token: str) -> None:
        person, detection = Connection(self.plan["port"], token), f"/detections/{self.plan['detection']}"
        progress = f"{detection}/progress?camera=front"
        await person.open()
        await self._ask(person, "progress", "GET", progress)
        await self._think()
        wanted = {"camera": "front", "ahead": _AHEAD}
        while True:
            status, task = await self._ask(person, "take", "POST", f"{detection}/tasks/next", wanted)
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
            status, taken = await self._ask(person, "answer", "POST", f"/tasks/{task['task_id']}/answer", answer)
            self.accepted += status == 200
            if status != 200 or taken["progress"] is None:
                await self._ask(person, "progress", "GET", progress)

    async def _think(self) -> None:
        await asyncio.sleep(self._draw.uniform(*self.plan["think_s"]))

    async def _page(self, token: str) -> None:
        stream, page = (Connection(self.plan["port"], token) for _ in range(2))
        detection = self.plan["detection"]
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
                await self._ask(page, "page", "GET", progress)

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
        person = Connection(self.plan["port"], token)
        await person.open()
        while True:
            await self._ask(person, "bystander", "GET", "/recordings?limit=10")
            await asyncio.sleep(_PAUSE_S)


def main() -> None:
    """Run and print."""
    load = Load(json.load(sys.stdin))
    asyncio.run(load.run())
    print(json.dumps({"seconds": load.seconds, "accepted": load.accepted, "ms": load.ms, "statuses": load.statuses}))


if __name__ == "__main__":
    main()
