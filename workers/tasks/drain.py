"""How a pool process stops early: on the parent's signal the job in hand is interrupted, and no other is begun.

SIGTERM is not used for it: Celery ends a task with that which ran past its time limit, and such a job counts as lost.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

DRAIN_SIGNAL = signal.SIGUSR2


class DrainedError(BaseException):
    """The worker was told to stop; raised into whatever it was doing."""


class _State:
    draining = False
    interruptible = False


def listen_for_drain() -> None:
    """Install the handler in a pool process."""
    signal.signal(DRAIN_SIGNAL, _drain)


def is_draining() -> bool:
    """Whether no further job should be claimed."""
    return _State.draining


@contextmanager
def interruptible() -> Iterator[None]:
    """Where a drain may interrupt. Raises :class:`DrainedError`.

    Also where something else arrives after the signal: a driver that was interrupted within a statement may raise an
    error of its own instead, which says nothing of the work.
    """
    _State.interruptible = True
    try:
        if _State.draining:
            raise DrainedError
        yield
    except Exception as error:
        if _State.draining:
            raise DrainedError from error
        raise
    finally:
        _State.interruptible = False


def _drain(number: int, frame: FrameType | None) -> None:
    _State.draining = True
    if _State.interruptible:
        raise DrainedError
