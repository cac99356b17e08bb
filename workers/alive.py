"""Touches a file while a worker or the sweeper makes progress; health checks of containers read its age.

Asking through the broker (``celery inspect ping``) would start a Python of a second for every answer.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from celery import Celery, bootsteps

from service.platform.settings import get_settings

_EVERY_S = 5.0


class Alive(bootsteps.StartStopStep):
    """Touches the file from the worker's own event loop, which is what hangs when a worker hangs."""

    requires = frozenset(("celery.worker.components:Timer",))

    def __init__(self, parent: Any, **options: Any) -> None:
        super().__init__(parent, **options)
        self._file = get_settings().alive_file
        self._timer: Any = None

    def start(self, parent: Any) -> None:
        """Begin, when the worker begins."""
        if self._file:
            touch(self._file)
            self._timer = parent.timer.call_repeatedly(_EVERY_S, touch, (self._file,))

    def stop(self, parent: Any) -> None:
        """End, when the worker ends."""
        if self._timer:
            self._timer.cancel()


def install(app: Celery) -> None:
    """Let the application's workers touch the file, where the settings name one."""
    steps: Any = app.steps
    steps["worker"].add(Alive)


@contextlib.contextmanager
def meanwhile(step: Callable[[], object], every_s: float) -> Iterator[None]:
    """Take a step at once, and then from a thread at this period until the block ends. Nothing is forked in it."""
    ended = threading.Event()

    def repeat() -> None:
        while not ended.wait(every_s):
            step()

    step()
    repeating = threading.Thread(target=repeat, name="meanwhile", daemon=True)
    repeating.start()
    try:
        yield
    finally:
        ended.set()
        repeating.join()


def touched_meanwhile() -> AbstractContextManager[None]:
    """Touch the file while the block works: a worker that compiles is not taken for one that hangs."""
    file = get_settings().alive_file
    return meanwhile(lambda: file and touch(file), _EVERY_S)


def touch(file: Path) -> None:
    """Make the file young, and make it where it is missing."""
    file.touch()
