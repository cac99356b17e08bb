"""Early stops of a pool process: on the parent's signal the job in hand is interrupted, and no other is begun.

SIGTERM is not used for it: Celery ends a task with that which ran past its time limit, and such a job counts as lost.

Python runs a signal's handler between two bytecodes of the main thread, so never while a kernel runs. A thread of its
own therefore reads the signals' wakeup pipe, and stops the kernel by the lease's flag.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from service.platform.jobs.claims import Lease

DRAIN_SIGNAL = signal.SIGUSR2


class DrainedError(BaseException):
    """The worker was told to stop; raised into whatever it was doing."""


class _State:
    draining = False
    lease: Lease | None = None  # of the job in hand, where a drain may interrupt it


def listen_for_drain() -> None:
    """Install the handler in a pool process. Call it in the main thread."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.signal(DRAIN_SIGNAL, _drain)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    threading.Thread(target=_stop_kernels, args=(reading,), name="drain", daemon=True).start()


def is_draining() -> bool:
    """Whether no further job should be claimed."""
    return _State.draining


@contextmanager
def interruptible(lease: Lease) -> Iterator[None]:
    """Let a drain interrupt the block. Raises :class:`DrainedError`.

    Also where something else arrives after the signal: a driver that was interrupted within a statement may raise an
    error of its own instead, which says nothing of the work.
    """
    _State.lease = lease
    try:
        if _State.draining:
            raise DrainedError
        yield
    except Exception as error:
        if _State.draining:
            raise DrainedError from error
        raise
    finally:
        _State.lease = None


def _drain(number: int, frame: FrameType | None) -> None:
    _State.draining = True
    if _State.lease:
        raise DrainedError


def _stop_kernels(reading: int) -> None:
    """End the computation when the signal arrives; the pipe gets the number of each signal."""
    while received := os.read(reading, 64):
        lease = _State.lease
        if DRAIN_SIGNAL in received and lease:
            lease.stop(DrainedError)
    os.close(reading)
