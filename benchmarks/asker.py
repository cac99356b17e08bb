"""Somebody who asks for single calibrations and waits for their ends."""

from __future__ import annotations

import threading
import time
from typing import Any
from uuid import UUID

from sqlalchemy import select

from benchmarks.accuracy.rigs import Rig
from benchmarks.house import House
from benchmarks.vehicles import one_vehicle
from service.platform.db.calibrations import Calibration

# A hint may be lost.
_LOOK_S = 0.5


class Asker:
    """One vehicle of a fleet of its own; every request is the same work, bit for bit."""

    def __init__(self, house: House, rig: Rig, calibration: dict[str, Any], fleet: str = "asker") -> None:
        self._house, self._calibration = house, calibration
        self._one = one_vehicle(house.client, fleet, rig)
        self._thread: threading.Thread | None = None
        self.seconds: list[float] = []

    def ask(self) -> tuple[float, UUID]:
        """Ask for the calibration; the seconds until it has ended, and its id."""
        with self._house.changes(self._one.fleet) as change:
            began = time.perf_counter()
            calibrations = self._house.client.calibrations
            id = calibrations.create(self._one.vehicle, [self._one.pairs], **self._calibration).id
            # Neither the API nor the database is asked over and over: that would cost the farm its own cores.
            while (state := self._state(id)) in ("queued", "running"):
                change(_LOOK_S)
            assert state == "done", state
            return time.perf_counter() - began, id

    def begin(self) -> None:
        """Ask from a thread of its own; the time it takes goes to ``seconds``."""
        self._thread = threading.Thread(target=lambda: self.seconds.append(self.ask()[0]))
        self._thread.start()

    @property
    def is_waiting(self) -> bool:
        """Whether a request that was begun has not ended."""
        return self._thread is not None and self._thread.is_alive()

    def _state(self, id: UUID) -> str:
        with self._house.database.reading() as session:
            return session.scalars(select(Calibration.state).where(Calibration.id == id)).one()
