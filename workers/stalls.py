"""Ends a sweeper that gets nowhere, so that whoever supervises it starts it again.

The sweep recovers everything else, so nothing else can recover the sweep. What hangs in a library or in the kernel
raises no error; a thread of the interpreter's own, outside of Python, counts the time.
"""

from __future__ import annotations

import faulthandler

from service.platform.settings import get_settings


def expect_progress() -> None:
    """Write the stacks of all threads to the log and exit, unless this is called again within ``stalled_s``."""
    settings = get_settings()
    faulthandler.dump_traceback_later(max(settings.stalled_s, 5 * settings.sweep_s), exit=True)
