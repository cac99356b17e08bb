"""The stop of an API process, without a failed request.

After SIGTERM the process serves on for ``drain_s`` seconds. /readyz answers 503, so that load balancers turn to
others. Each answer says ``Connection: close``, so that no client sends its next request on a connection that is about
to end. Then event streams end, and uvicorn finishes the requests under way and stops.
"""

from __future__ import annotations

import asyncio
import logging
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

log = logging.getLogger(__name__)


class Drain:
    """The state of a stopping process: ``asked`` since SIGTERM, ``over`` when the delay has passed."""

    def __init__(self, delay_s: float) -> None:
        self.asked = False
        self.over = asyncio.Event()
        self._delay_s = delay_s

    @contextmanager
    def before_stopping(self) -> Iterator[None]:
        """Delay the server's own handling of SIGTERM, in the running event loop.

        Outside the main thread no signals arrive, so nothing is installed there.
        """
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        servers = signal.getsignal(signal.SIGTERM)
        loop = asyncio.get_running_loop()

        def on_signal(number: int, frame: FrameType | None) -> None:
            loop.call_soon_threadsafe(self._begin, lambda: _call(servers, number))

        signal.signal(signal.SIGTERM, on_signal)
        try:
            yield
        finally:
            signal.signal(signal.SIGTERM, servers)

    def _begin(self, stop: Callable[[], None]) -> None:
        def leave() -> None:
            self.over.set()
            stop()

        if self.asked:
            leave()
            return
        self.asked = True
        log.info("asked to stop; new requests are answered for %g s more", self._delay_s)
        asyncio.get_running_loop().call_later(self._delay_s, leave)


def _call(handler: Any, number: int) -> None:
    if callable(handler):
        handler(number, None)
