"""A second fleet's single request: how long it takes, alone and while a thousand vehicles of another fleet wait."""

from __future__ import annotations

import threading
import time
from typing import Any

from apexcal.client import Client
from benchmarks.accuracy.rigs import Rig
from benchmarks.fleet.vehicles import bring

_LOOK_S = 0.02


class Bystander:
    """One vehicle of a fleet of its own; every request is the same work, bit for bit."""

    def __init__(self, client: Client, rig: Rig, calibration: dict[str, Any]) -> None:
        self._client = client
        self._calibration = calibration
        fleet = client.fleets.create("bystander")
        (self._vehicle,) = bring(client, fleet["id"], [rig])
        (described,) = client.vehicles.rigs(self._vehicle)
        (pairs,) = client.correspondence_sets.list(described["id"])
        self._pairs = pairs["id"]
        self._thread: threading.Thread | None = None
        self.seconds: list[float] = []

    def ask(self) -> float:
        """Ask for the calibration and wait for its end; the seconds that it took."""
        began = time.perf_counter()
        work = self._client.calibrations.create(self._vehicle, [self._pairs], **self._calibration)
        while work["state"] in ("queued", "running"):
            time.sleep(_LOOK_S)
            work = self._client.calibrations.get(work["id"])
        assert work["state"] == "done", work
        return time.perf_counter() - began

    def begin(self) -> None:
        """Ask from a thread of its own; the time it takes goes to ``seconds``."""
        self._thread = threading.Thread(target=lambda: self.seconds.append(self.ask()))
        self._thread.start()

    @property
    def is_waiting(self) -> bool:
        """Whether a request that was begun has not ended."""
        return self._thread is not None and self._thread.is_alive()
