"""Supervises the children: restarts a dead one, ends all with the command, writes their state to a file."""

from __future__ import annotations

import json
import os
import select
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType

from apexcal.embedded.children import Child, ChildPlan

_LONGEST_NAP_S = 5.0


class Supervisor:
    """Children in the order of their start. Runs in the main thread, because it takes the signals."""

    def __init__(self, status: Path, url: str, public_url: str) -> None:
        self._status = status
        self._url = url
        self._public_url = public_url
        self._children: list[Child] = []
        self._stops = 0
        self._wake, self._woken = os.pipe()
        os.set_blocking(self._woken, False)
        os.set_blocking(self._wake, False)
        signal.set_wakeup_fd(self._woken, warn_on_full_buffer=False)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            # Under `nohup` SIGHUP is ignored on purpose.
            if signal.getsignal(number) is not signal.SIG_IGN or number != signal.SIGHUP:
                signal.signal(number, self._stop)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)

    @property
    def stopping(self) -> bool:
        """Whether somebody asked for the end."""
        return self._stops > 0

    def start(self, plan: ChildPlan) -> Child:
        """Start a child and watch it from now on."""
        child = Child(plan)
        self._children.append(child)
        child.start()
        self._write()
        return child

    def until(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Watch until ``ready``; False when that takes too long or somebody asked for the end."""
        deadline = time.monotonic() + timeout_s
        while not self.stopping and time.monotonic() < deadline:
            if ready():
                return True
            self._watch(0.05)
        return False

    def watch(self) -> None:
        """Watch until somebody asks for the end."""
        while not self.stopping:
            self._watch(_LONGEST_NAP_S)

    def stop(self, order: Sequence[str]) -> None:
        """End the named children one after the other, then all others. A second signal kills at once."""
        by_name = {child.plan.name: child for child in self._children}
        rest = [name for name in by_name if name not in order]
        for name in (*order, *rest):
            if child := by_name.get(name):
                child.ask_to_stop()
                self._write()
                child.wait(lambda: self._stops > 1)
        self._write()

    def _watch(self, nap_s: float) -> None:
        """Sleep until a signal, a due restart or the nap's end, then look at every child."""
        due = min((child.due_in() for child in self._children), default=nap_s)
        if select.select([self._wake], [], [], min(due, nap_s))[0]:
            os.read(self._wake, 4096)
        if not self.stopping:
            for child in self._children:
                child.bound_log()
            changed = [child.poll() for child in self._children]
            if any(changed):
                self._write()

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self._stops += 1

    def _write(self) -> None:
        """Replace the status file in one step, so that a reader never sees half of it."""
        document = {
            "pid": os.getpid(),
            "url": self._url,
            "public_url": self._public_url,
            "children": [
                {
                    "name": child.plan.name,
                    "pid": child.pid,
                    "state": child.state,
                    "restarts": child.restarts,
                    "since": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(child.since)),
                }
                for child in self._children
            ],
        }
        beside = self._status.with_suffix(".tmp")
        beside.write_text(json.dumps(document))
        beside.replace(self._status)
