"""Two contenders for the same cores, taking turns: while one works the other is stopped (SIGSTOP).

Whatever else the machine does hits both alike.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

# Shorter than the renewal of a lease, so that no stopped worker loses one.
SLICE_S = 2.5
_LOOK_S = 0.05


@dataclass
class Contender:
    """Processes that may be stopped, how to tell that they are done, and how long they worked."""

    pids: Sequence[int]
    is_done: Callable[[], bool]
    seconds: float = 0.0
    _since: float | None = field(default=None)

    def go(self) -> None:
        """Let it work."""
        if self._since is None:
            self._signal(signal.SIGCONT)
            self._since = time.perf_counter()

    def halt(self) -> None:
        """Stop it where it is."""
        if self._since is not None:
            self.seconds += time.perf_counter() - self._since
            self._since = None
            self._signal(signal.SIGSTOP)

    def turn(self, stay: Callable[[], bool] = lambda: False) -> None:
        """Work for a slice, longer while ``stay`` says so, shorter where the work ends."""
        self.go()
        end = time.perf_counter() + SLICE_S
        while stay() or (time.perf_counter() < end and not self.is_done()):
            time.sleep(_LOOK_S)
        self.halt()

    def _signal(self, number: signal.Signals) -> None:
        for pid in self.pids:
            os.kill(pid, number)
