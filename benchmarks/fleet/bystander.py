"""A second fleet's single request: how long it takes, alone and while a thousand vehicles of another fleet wait."""

from __future__ import annotations

import threading
import time
from typing import Any

from benchmarks.accuracy.rigs import Rig
from benchmarks.fleet.vehicles import bring
from benchmarks.house import House

# A hint may be lost.
_LOOK_S = 0.5


class Bystander:
    """One vehicle of a fleet of its own; every request is the same work, bit for bit."""

    def __init__(self, house: House, rig: Rig, calibration: dict[str, Any]) -> None:
        self._house = house
        self._client = client = house.client
        self._calibration = calibration
        self._fleet = client.fleets.create("bystander").id
        (self._vehicle,) = bring(client, self._fleet, [rig])
        (described,) = client.vehicles.rigs(self._vehicle)
        (pairs,) = client.correspondence_sets.list(described.id)
        self._pairs = pairs.id
        self._thread: threading.Thread | None = None
        self.seconds: list[float] = []

    def ask(self) -> float:
        """Ask for the calibration and wait for its end; the seconds that it took."""
        with self._house.changes(self._fleet) as change:
            began = time.perf_counter()
            work = self._client.calibrations.create(self._vehicle, [self._pairs], **self._calibration)
            while work.state in ("queued", "running"):
                change(_LOOK_S)
                work = self._client.calibrations.get(work.id)
            assert work.state == "done", work
            return time.perf_counter() - began

    def begin(self) -> None:
        """Ask from a thread of its own; the time it takes goes to ``seconds``."""
        self._thread = threading.Thread(target=lambda: self.seconds.append(self.ask()))
        self._thread.start()

    @property
    def is_waiting(self) -> bool:
        """Whether a request that was begun has not ended."""
        return self._thread is not None and self._thread.is_alive()
