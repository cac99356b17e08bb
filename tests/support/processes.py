"""Children that never outlive the tests."""

import contextlib
import os
import signal
import socket
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from apexcal.processes import tied_to_this


def start(command: list[str], log: Path, **options: Any) -> subprocess.Popen[bytes]:
    """Start a child that ends with this process; its output goes to ``log``."""
    with log.open("ab") as output:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            preexec_fn=tied_to_this(),
            **options,
        )


def stop(child: subprocess.Popen[bytes], how: signal.Signals = signal.SIGTERM) -> None:
    """End a child, kindly first."""
    stop_all([child], how)


def stop_all(
    children: Iterable[subprocess.Popen[bytes]], how: signal.Signals = signal.SIGTERM, grace_s: float = 10.0
) -> None:
    """End children, kindly first; they end side by side."""
    told = list(children)
    for child in told:
        with contextlib.suppress(ProcessLookupError):
            child.send_signal(how)
    for child in told:
        try:
            child.wait(grace_s)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def children(pid: int) -> list[int]:
    """The children of a process."""
    found: list[int] = []
    for listed in Path("/proc").glob(f"{pid}/task/*/children"):
        with contextlib.suppress(OSError):
            found += [int(word) for word in listed.read_text().split()]
    return found


def send(pids: Sequence[int], signal_number: int) -> None:
    """Send a signal to processes, some of which may be gone."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal_number)


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def is_ready(url: str, patience_s: float = 5.0) -> bool:
    """Whether a balancer would ask the API at this address."""
    try:
        with urllib.request.urlopen(f"{url}/readyz", timeout=patience_s) as answer:
            return answer.status == 200
    except OSError:
        return False


def wait_until(true: Callable[[], bool], what: str, seconds: float = 120.0, every_s: float = 0.02) -> None:
    """Poll until ``true()``, or fail saying what did not happen."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, f"{what} did not happen within {seconds} s"
        time.sleep(every_s)
