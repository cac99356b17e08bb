"""A fleet request beside another writer of the same fleet."""

from __future__ import annotations

import threading
import time
from uuid import UUID

from sqlalchemy import func, select

from benchmarks.growth.vehicles import bring_many
from benchmarks.house import House
from service.platform.db.fleet_requests import FleetRequestVehicle

_CALIBRATION = {"models": ["pinhole"], "folds": 0}
_PAUSE_S = 0.02


def measure(house: House, vehicles: int) -> dict[str, float]:
    """Seconds until all calibrations are made, of the answer, and of the longest write of somebody else."""
    house.restart_worker(0)
    fleet = house.client.fleets.create(f"fleet of {vehicles}")
    bring_many(house, fleet.id, vehicles, vehicles)
    writer = _Writer(house, fleet.id)
    writer.start()
    began = time.perf_counter()
    request = house.client.fleet_requests.create(fleet.id, {"name": "vehicle *"}, **_CALIBRATION)
    answered_s = time.perf_counter() - began
    due = select(func.count()).where(
        FleetRequestVehicle.fleet_request_id == request.id, FleetRequestVehicle.calibration_id.is_(None)
    )
    while _count(house, due):
        time.sleep(0.2)
    total_s = time.perf_counter() - began
    writer.enough.set()
    writer.join(60)
    house.client.fleet_requests.cancel(request.id)
    return {"seconds": total_s, "answer_s": answered_s, "longest_write_s": max(writer.seconds)}


def _count(house: House, statement: object) -> int:
    with house.database.reading() as session:
        return session.scalar(statement) or 0  # type: ignore[call-overload]


class _Writer(threading.Thread):
    """Makes a vehicle of the same fleet again and again; how long each took."""

    def __init__(self, house: House, fleet_id: UUID) -> None:
        super().__init__(daemon=True)
        self.seconds: list[float] = []
        self.enough = threading.Event()
        self._house, self._fleet_id = house, fleet_id

    def run(self) -> None:
        number = 0
        while not self.enough.is_set():
            began = time.perf_counter()
            self._house.client.vehicles.create(self._fleet_id, f"other {number}")
            self.seconds.append(time.perf_counter() - began)
            number += 1
            time.sleep(_PAUSE_S)
