"""Calibrations of made pairs, asked of the service as any client does, and timed to their end."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any
from uuid import UUID

from sqlalchemy import func, select

from benchmarks.accuracy.rigs import Rig
from benchmarks.fleet.vehicles import bring
from benchmarks.house import House
from service.platform.db.calibrations import Calibration

# A hint may be lost.
_LOOK_S = 0.5


class Asker:
    """One vehicle of a fleet of its own, and its pairs. The same request is the same work, bit for bit."""

    def __init__(self, house: House, name: str, rig: Rig) -> None:
        self._house = house
        client = house.client
        self._fleet = client.fleets.create(name).id
        (self._vehicle,) = bring(client, self._fleet, [rig])
        (described,) = client.vehicles.rigs(self._vehicle)
        (pairs,) = client.correspondence_sets.list(described.id)
        self._pairs = pairs.id

    def ask(self, count: int = 1, **request: Any) -> tuple[float, list[UUID]]:
        """Ask for ``count`` calibrations one after the other; the seconds until the last has ended, and their ids."""
        with self._house.changes(self._fleet) as change:
            began = time.perf_counter()
            ids = [self.begin(**request) for _ in range(count)]
            self._wait(ids, change)
            return time.perf_counter() - began, ids

    def begin(self, **request: Any) -> UUID:
        """Ask for a calibration and do not wait."""
        return self._house.client.calibrations.create(self._vehicle, [self._pairs], **request).id

    def wait(self, ids: Sequence[UUID]) -> None:
        """Wait until these are done."""
        with self._house.changes(self._fleet) as change:
            self._wait(ids, change)

    def _wait(self, ids: Sequence[UUID], change: Callable[[float], object]) -> None:
        # Neither the API nor the database is asked over and over: that would cost the farm its own cores.
        while self._count(ids, "queued", "running"):
            change(_LOOK_S)
        assert self._count(ids, "done") == len(ids), "a calibration failed"

    def _count(self, ids: Sequence[UUID], *states: str) -> int:
        asked = select(func.count()).where(Calibration.id.in_(ids), Calibration.state.in_(states))
        with self._house.database.reading() as session:
            return session.scalar(asked) or 0
