"""A load balancer of forty lines: new connections go to who says /readyz, existing ones are left alone."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import threading
from collections.abc import Sequence

from tests.support.processes import is_ready

_LOOK_S = 0.2


class Balancer:
    """TCP on a port of its own, from a thread of its own."""

    def __init__(self, backends: Sequence[int]) -> None:
        self.ready: set[int] = set()
        self.port = 0
        self._backends = backends
        self._turn = itertools.count()
        self._looks: list[asyncio.Task[None]] = []
        self._loop = asyncio.new_event_loop()
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self._started.wait(10)

    def close(self) -> None:
        """End every connection and the thread."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(10)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        server = self._loop.run_until_complete(asyncio.start_server(self._serve, "127.0.0.1", 0))
        self.port = server.sockets[0].getsockname()[1]
        for port in self._backends:
            # Kept, for a loop holds its tasks weakly.
            self._looks.append(self._loop.create_task(self._look(port)))
        self._started.set()
        self._loop.run_forever()
        server.close()
        tasks = asyncio.all_tasks(self._loop)
        for task in tasks:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        # What was aborted is closed in the loop's next turns.
        self._loop.run_until_complete(asyncio.sleep(0.05))
        self._loop.close()

    async def _look(self, port: int) -> None:
        while True:
            healthy = await asyncio.to_thread(is_ready, f"http://127.0.0.1:{port}")
            (self.ready.add if healthy else self.ready.discard)(port)
            await asyncio.sleep(_LOOK_S)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        number = next(self._turn)
        ready = sorted(self.ready) or list(self._backends)
        opened = [writer]
        try:
            backend_reader, backend_writer = await asyncio.open_connection("127.0.0.1", ready[number % len(ready)])
            opened.append(backend_writer)
            await asyncio.gather(_pipe(reader, backend_writer), _pipe(backend_reader, writer))
        except asyncio.CancelledError:
            # The end of the balancer, which is nothing to complain of.
            for one in opened:
                one.transport.abort()


async def _pipe(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(ConnectionError):
        while data := await reader.read(65536):
            writer.write(data)
            await writer.drain()
    with contextlib.suppress(ConnectionError, OSError):
        writer.close()
