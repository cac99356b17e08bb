"""Checks the parts of a service within a time limit, keeps each answer for a moment, and abandons checks that hang.

However often somebody asks, a part is checked once per ``fresh_s``. What a driver said goes to the log only.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from typing import Any

# Nobody waits longer for a part that hangs.
PATIENCE_S = 2.0
FRESH_S = 1.0
# Whoever starts a service polls until all parts work.
AGAIN_S = 0.25

Answer = dict[str, Any]

log = logging.getLogger(__name__)


class Part:
    """A part and its last state. ``look`` returns ``ok`` and, in words for anybody, the reason if it is not.

    A part that works is checked again after ``fresh_s`` seconds, one that does not after :data:`AGAIN_S`.
    """

    def __init__(self, name: str, look: Callable[[], Answer], fresh_s: float = FRESH_S) -> None:
        self.name = name
        self._ask = look
        self._fresh_s = fresh_s
        self._guard = threading.Lock()
        self._future: Future[Answer] | None = None
        self._began = self._ended = 0.0
        self._was = ""

    def current_look(self) -> Future[Answer]:
        """Return the look that answers now: the last one while it is fresh or under way, else a new one."""
        with self._guard:
            if self._future is None or (self._future.done() and self._is_stale(self._future.result())):
                self._future = Future()
                self._future.set_running_or_notify_cancel()  # who stops waiting does not end it for others
                self._began = time.monotonic()
                # A daemon, for a process must be able to leave while a disk or a database hangs.
                threading.Thread(
                    target=self._run, args=(self._future,), name=f"look {self.name}", daemon=True
                ).start()
            return self._future

    def patience(self) -> float:
        """Return how many seconds more to wait for the look that is under way."""
        return max(0.0, self._began + PATIENCE_S - time.monotonic())

    def answer(self, future: Future[Answer]) -> Answer:
        """Return the result of this look, or that it did not end in time."""
        if not future.done():
            self._note(f"no answer within {PATIENCE_S:g} s")
            return {"ok": False, "detail": f"no answer within {PATIENCE_S:g} s"}
        return future.result()

    def _is_stale(self, answer: Answer) -> bool:
        return time.monotonic() - self._ended >= (self._fresh_s if answer["ok"] else AGAIN_S)

    def _run(self, future: Future[Answer]) -> None:
        began = time.perf_counter()
        try:
            answer = self._ask()
            self._note(answer.get("detail", ""))
        except Exception as error:
            answer = {"ok": False, "detail": "does not answer as it should; the service's log says more"}
            self._note(f"{type(error).__name__}: {error}".partition("\n")[0])
        self._ended = time.monotonic()
        future.set_result(answer | {"milliseconds": round((time.perf_counter() - began) * 1000, 1)})

    def _note(self, why: str) -> None:
        """Log the reason when it changes, not at every look."""
        if why != self._was:
            self._was = why
            log.warning("readiness: %s: %s", self.name, why or "works again")


async def ask_parts(parts: Iterable[Part]) -> dict[str, Answer]:
    """Return the state of each part, within :data:`PATIENCE_S`."""
    answers = [(part, part.current_look()) for part in parts]
    for part, future in answers:
        await asyncio.wait([asyncio.wrap_future(future)], timeout=part.patience())
    return {part.name: part.answer(future) for part, future in answers}
