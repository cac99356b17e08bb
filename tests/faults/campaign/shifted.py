"""Run a program whose clock is wrong: ``python -m tests.faults.campaign.shifted SECONDS MODULE ARGUMENTS``.

Shifts what Python calls the time (``time.time``, ``time.time_ns``, ``datetime.now``) before the program
is imported. Timers and sleeps go on as they are, as they do on a host whose clock is set wrongly.
"""

from __future__ import annotations

import datetime
import runpy
import sys
import time
from datetime import timedelta, tzinfo
from typing import Any


class _Kind(type):
    """Every datetime counts as one of the shifted class."""

    def __instancecheck__(cls, instance: Any) -> bool:
        return isinstance(instance, _real_datetime)


_real_datetime = datetime.datetime


def shift(seconds: float) -> None:
    """From now on this process believes that it is ``seconds`` later than it is."""
    real_time, real_time_ns = time.time, time.time_ns

    class Shifted(_real_datetime, metaclass=_Kind):
        __slots__ = ()  # compiled modules look at the size

        @classmethod
        def now(cls, tz: tzinfo | None = None) -> _real_datetime:  # type: ignore[override]
            return _real_datetime.now(tz) + timedelta(seconds=seconds)

        @classmethod
        def utcnow(cls) -> _real_datetime:  # type: ignore[override]
            return _real_datetime.now(datetime.UTC).replace(tzinfo=None) + timedelta(seconds=seconds)

    replaced: dict[str, Any] = {
        "time": lambda: real_time() + seconds,
        "time_ns": lambda: real_time_ns() + round(seconds * 1e9),
    }
    for name, clock in replaced.items():
        setattr(time, name, clock)
    setattr(datetime, "datetime", Shifted)  # noqa: B010 - a checker takes the plain form for a new type


if __name__ == "__main__":
    shift(float(sys.argv[1]))
    module = sys.argv[2]
    del sys.argv[:2]
    runpy.run_module(module, run_name="__main__", alter_sys=True)
