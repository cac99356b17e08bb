"""One child process: started so that it cannot outlive its parent, ended with everything that it started."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from apexcal.processes import has_ended, kill_session, tied_to_this

_FIRST_DELAY_S = 0.2
_LONGEST_DELAY_S = 10.0
_STEADY_S = 20.0
# A hundred thousand lines, and as many before them: a day of a busy service.
_LOG_BYTES = 10 * 1024 * 1024


@dataclass(frozen=True)
class ChildPlan:
    """How a child is started and stopped. ``environment`` is complete, not an addition."""

    name: str
    command: tuple[str, ...]
    environment: Mapping[str, str]
    log: Path
    grace_s: float = 10.0


class Child:
    """A planned child and, while it runs, its process. A dead one may be started again after a growing delay."""

    def __init__(self, plan: ChildPlan) -> None:
        self.plan = plan
        self.restarts = 0
        self.state = "stopped"
        self.since = time.time()
        self._process: subprocess.Popen[bytes] | None = None
        self._started = 0.0
        self._due = 0.0
        self._delay = _FIRST_DELAY_S

    @property
    def pid(self) -> int | None:
        """Process id while it runs."""
        return self._process.pid if self._process else None

    def start(self) -> None:
        """Start the process in a session of its own, so that a terminal's Ctrl-C reaches the supervisor alone."""
        self.bound_log()
        with self.plan.log.open("ab") as output:
            self._process = subprocess.Popen(
                self.plan.command,
                env=dict(self.plan.environment),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=tied_to_this(),
            )
        self._started = time.monotonic()
        self._turn("running")

    def poll(self) -> bool:
        """Note a death, or start again when that is due. Returns whether something changed."""
        if self._process is not None:
            if not self._ended():
                return False
            if time.monotonic() - self._started > _STEADY_S:
                self._delay = _FIRST_DELAY_S
            self._due = time.monotonic() + self._delay
            self._delay = min(self._delay * 2, _LONGEST_DELAY_S)
            self._turn("restarting")
            return True
        if self.state == "restarting" and time.monotonic() >= self._due:
            self.restarts += 1
            self.start()
            return True
        return False

    def bound_log(self) -> None:
        """Once the log is too long, keep its end beside it and empty it; the child goes on writing to the same file.

        The child appends, so its next line stands at the beginning. A line of this very moment may be lost.
        """
        log = self.plan.log
        if not log.exists() or log.stat().st_size <= _LOG_BYTES:
            return
        # A full disk keeps nothing beside it.
        with contextlib.suppress(OSError), log.open("rb") as full, log.with_suffix(".log.1").open("wb") as rotated:
            full.seek(-_LOG_BYTES, os.SEEK_END)
            # No more than that, however fast the child writes meanwhile.
            rotated.write(full.read(_LOG_BYTES))
        os.truncate(log, 0)

    def due_in(self) -> float:
        """Seconds until a restart is due; infinite when none is."""
        return max(0.0, self._due - time.monotonic()) if self.state == "restarting" else float("inf")

    def ask_to_stop(self) -> None:
        """Send SIGTERM. For a worker that means: finish or give back what you hold, then leave."""
        if self._process is not None and not self._ended():
            self._process.send_signal(signal.SIGTERM)
        self._turn("stopping")

    def wait(self, hurry: Callable[[], bool]) -> None:
        """Wait for the end within the plan's grace, or until ``hurry`` says so; then kill the whole session."""
        deadline = time.monotonic() + self.plan.grace_s
        while self._process is not None and not self._ended():
            if time.monotonic() > deadline or hurry():
                kill_session(self._process.pid)
            time.sleep(0.02)
        self._turn("stopped")

    def _turn(self, state: str) -> None:
        self.state, self.since = state, time.time()

    def _ended(self) -> bool:
        """Whether the process is gone; if so, reap it and kill what it left behind (a pool's orphans)."""
        process = self._process
        if process is None:
            return True
        if not has_ended(process.pid):
            return False
        kill_session(process.pid)
        process.wait()
        self._process = None
        return True
