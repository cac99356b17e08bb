"""Repeats a store operation before its failure counts."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from service.platform.storage.errors import StoreUnavailableError

# Seconds between the tries, each of which has the store's own time limit.
PAUSES_S = (0.5, 2.0)

T = TypeVar("T")


def retried(attempt: Callable[[], T]) -> T:
    """What ``attempt`` returns. Raises :class:`StoreUnavailableError` where the last try fails too."""
    for pause in PAUSES_S:
        try:
            return attempt()
        except StoreUnavailableError:
            time.sleep(pause)
    return attempt()
