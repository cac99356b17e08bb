"""Requests at a steady rate over connections that stay open, each timed from the moment when it was due.

``python -m benchmarks.retrieval.load`` reads a plan as JSON from standard input (port, token, rate, seconds, and
``asks``: paths with an ETag or none), asks for one after the other, and prints milliseconds and answers by status. It
is a process of its own, so that what it does with its time is not the service's.
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections import Counter
from typing import Any

from benchmarks.connection import Connection

_CONNECTIONS = 64
# The first so many seconds fill caches and connections; what is asked later is measured.
WARM_S = 2.0


async def run(plan: dict[str, Any]) -> dict[str, Any]:
    """Send everything, and wait for the answers. A connection that breaks ends it."""
    loop = asyncio.get_running_loop()
    due: asyncio.Queue[tuple[float, str, str]] = asyncio.Queue()
    ms: list[float] = []
    statuses = Counter[int]()
    connections = [Connection(plan["port"], plan["token"]) for _ in range(_CONNECTIONS)]
    await asyncio.gather(*(connection.open() for connection in connections))
    began = loop.time() + 0.1

    async def answer(connection: Connection) -> None:
        while True:
            when, path, etag = await due.get()
            status, _ = await connection.ask("GET", path, etag=etag)
            if when - began >= WARM_S:
                ms.append(1000.0 * (loop.time() - when))
                statuses[status] += 1
            due.task_done()

    async def send() -> None:
        for number in range(int(plan["rate"] * (plan["seconds"] + WARM_S))):
            when = began + number / plan["rate"]
            await asyncio.sleep(max(when - loop.time(), 0.0))
            due.put_nowait((when, *plan["asks"][number % len(plan["asks"])]))
        await asyncio.wait_for(due.join(), 60)

    answering = [asyncio.create_task(answer(connection)) for connection in connections]
    done, _ = await asyncio.wait([*answering, sending := asyncio.create_task(send())], return_when="FIRST_COMPLETED")
    for task in done:
        task.result()
    assert sending in done
    for task in answering:
        task.cancel()
    return {"ms": ms, "statuses": statuses}


if __name__ == "__main__":
    print(json.dumps(asyncio.run(run(json.load(sys.stdin)))))
