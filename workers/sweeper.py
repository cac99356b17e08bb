"""The reaper: a process of its own that makes a pass every two seconds, ``python -m workers.sweeper``.

It is no pool process of the workers that solve, so a farm whose every process is busy for an hour is still swept. It
needs no broker and no clock of day: a period is told by the monotonic clock, which nobody sets.

The reaper recovers everything else, so nothing else can recover it: a sweeper without progress ends, and
whoever supervises it starts it again. What hangs in a library or in the kernel raises no error; a thread of the
interpreter's own, outside of Python, counts the time.
"""

from __future__ import annotations

import faulthandler
import logging
import signal
import threading
import time
from dataclasses import replace
from functools import cache

from service.platform.garbage import imports_done
from service.platform.jobs.reaper import reap
from service.platform.observability import logs
from service.platform.settings import get_settings, settings_or_exit
from service.platform.storage.store import Store
from workers.alive import touch
from workers.tasks.context import get_context, remove_leftovers


def expect_progress() -> None:
    """Write the stacks of all threads to the log and exit, unless this is called again within ``stalled_s``."""
    settings = get_settings()
    faulthandler.dump_traceback_later(max(settings.stalled_s, 5 * settings.sweep_s), exit=True)


# Removing objects is the reaper's least urgent step: a store that hangs must not delay the next pass.
_PATIENCE_S = 2.0

log = logging.getLogger(__name__)


@cache
def _store() -> Store:
    settings = get_settings()
    return Store(settings.blobs, replace(settings.s3, timeout_s=min(_PATIENCE_S, settings.store_timeout_s)))


def run(stopping: threading.Event) -> None:
    """Make passes until told to stop. If a pass fails, the next one still begins a period after it began."""
    settings = get_settings()
    while not stopping.is_set():
        began = time.monotonic()
        expect_progress()
        try:
            reap(get_context().database, _store(), expect_progress)
            remove_leftovers(settings.scratch)
        except Exception as error:
            log.warning("this sweep failed, the next one tries again: %s", f"{type(error).__name__}: {error}")
        if settings.alive_file:
            touch(settings.alive_file)
        stopping.wait(max(0.0, began + settings.sweep_s - time.monotonic()))


def main() -> None:
    """Run as a process; SIGTERM and SIGINT end it after the pass under way."""
    settings = settings_or_exit()
    logs.configure(settings.log_form, logging.WARNING)
    stopping = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopping.set())
    imports_done()
    run(stopping)


if __name__ == "__main__":
    main()
