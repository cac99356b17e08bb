"""Leases as one process sees them: lost is one whose value did not change for ``lease_s`` by its own clock.

No wall clock takes part. One that steps, here, at a worker or at the database, neither ends a lease nor prolongs it.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from datetime import datetime

from service.platform.settings import get_settings

LeaseValue = tuple[int, int, datetime | None]
"""A running job's id, attempt and ``lease_until``. Each renewal writes another ``lease_until``."""


class LeaseWatch:
    """Remembers since when each lease has its value, in seconds of watching."""

    def __init__(self) -> None:
        self._since: dict[LeaseValue, float] = {}
        self._watched_s = 0.0
        self._looked_at = time.monotonic()

    def lost(self, leases: Iterable[LeaseValue]) -> list[LeaseValue]:
        """Return those of the present leases that are lost. Whoever lost them is fenced out by the attempt."""
        settings = get_settings()
        moment = time.monotonic()
        # While this process was frozen, or saw no database, renewals went unseen: that time does not count.
        self._watched_s += min(moment - self._looked_at, 2 * settings.sweep_s)
        self._looked_at = moment
        self._since = {lease: self._since.get(lease, self._watched_s) for lease in leases}
        return [lease for lease, since in self._since.items() if self._watched_s - since >= settings.lease_s]
