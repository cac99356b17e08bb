"""A process that is told to stop."""

import os
import signal
from collections.abc import Callable, Iterator

import pytest

from workers.tasks import drain


@pytest.fixture
def told_to_stop(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    """This process listens as a pool process does; the test sends the signal."""
    monkeypatch.setattr(drain, "_State", type("State", (), {"draining": False, "lease": None}))
    before = signal.getsignal(drain.DRAIN_SIGNAL)
    drain.listen_for_drain()
    yield lambda: os.kill(os.getpid(), drain.DRAIN_SIGNAL)
    signal.signal(drain.DRAIN_SIGNAL, before)
    os.close(signal.set_wakeup_fd(-1))
