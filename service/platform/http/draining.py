"""Stops an API process without a failed request.

SIGTERM does not close the door at once. For ``drain_s`` seconds /readyz answers 503, so that whoever balances the
load looks elsewhere; requests are still answered, each with ``Connection: close``, so that no client keeps a
connection that is about to end under its next request. Then streams of events end, and uvicorn finishes what is in
hand and stops.
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
    """Whether this process is about to leave: ``asked`` by SIGTERM, ``over`` when the delay has passed."""

    def __init__(self, delay_s: float) -> None:
        self.asked = False
        self.over = asyncio.Event()
        self._delay_s = delay_s

    @contextmanager
    def before_stopping(self) -> Iterator[None]:
        """Stand before the server's own handling of SIGTERM, in the running event loop.

        Outside the main thread no signal arrives, and none is taken.
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
