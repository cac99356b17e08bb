"""`python -m benchmarks.fleet`: 1,000 vehicles (VEHICLES makes it shorter) in one request, beside the bare solver.

222 pairs each, `pinhole`, the default schedule, nothing held out. The service (API, PostgreSQL that syncs, broker,
two pool processes, sweeper) and two bare processes do the same runs on the same two cores, taking turns of
2.5 s: while one works the other is stopped. The service's time begins when the request is sent, and holds everything
until the last vehicle has ended; the bare processes have their documents in memory and keep their results there. The
results must be the same bits. Meanwhile a second fleet asks for single calibrations, timed beside the idle machine's.
What ends in ``by_cpu`` counts processor seconds of all processes, for a machine that has other things to do;
``cost_ms`` is that of a vehicle, by process. From these costs follows a table on stderr: what more hosts would bring
(`benchmarks.fleet.scaling`). The last line is JSON.
"""

from __future__ import annotations

import json
import os
import secrets
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from uuid import UUID

from sqlalchemy import ColumnElement, func, select

from benchmarks.asker import Asker
from benchmarks.bare import Bare, assert_same_bits, runs_of
from benchmarks.fleet.scaling import Scale, scaled
from benchmarks.fleet.turns import Contender
from benchmarks.house import House, cpu_s
from benchmarks.vehicles import bring, draw
from service.platform.db.calibrations import CalibrationRun
from service.platform.db.fleet_requests import FleetRequestVehicle
from service.platform.db.session import Database

_CALIBRATION: dict[str, Any] = {"models": ["pinhole"], "folds": 0, "farm": "auto"}
_IDLE_ROUNDS = 5
_LOOK_S = 0.01


def measure(vehicles: int, seed: int) -> dict[str, Any]:
    """The figures of a request for that many vehicles."""
    with tempfile.TemporaryDirectory(prefix="apexcal-fleet-") as folder:
        house = House(Path(folder) / "data")
        try:
            return _measure(house, Path(folder), vehicles, seed)
        finally:
            house.close()


def _measure(house: House, folder: Path, vehicles: int, seed: int) -> dict[str, Any]:
    rigs = draw(vehicles + 1, seed)
    fleet = house.client.fleets.create("fleet")
    bring(house.client, fleet.id, rigs[:-1])
    bystander = Asker(house, rigs[-1], _CALIBRATION)
    idle = [bystander.ask()[0] for _ in range(_IDLE_ROUNDS)]
    cpu = house.cpu_s()

    service = Contender(house.worker_pids, lambda: not _left(house.database, request.id))
    # Before anything is claimed: no lease ends while the bare processes get ready.
    service.go()
    service.halt()
    began = time.perf_counter()
    request = house.client.fleet_requests.create(fleet.id, **_CALIBRATION)
    service.seconds = time.perf_counter() - began
    # The service makes the calibrations in parts, and works meanwhile; the bare processes get all of its runs.
    service.go()
    while _count(house.database, request.id) < vehicles:
        time.sleep(_LOOK_S)
    service.halt()
    bare = Bare(runs_of(house.database, _asked_for(request.id)), folder)
    bare.begin()
    contender = Contender(bare.pids, lambda: bare.is_done)
    contender.go()
    contender.halt()
    bare_cpu = sum(map(cpu_s, bare.pids))
    disturbed = _take_turns(house, request.id, vehicles, service, contender, bystander)
    bare_cpu = sum(map(cpu_s, bare.pids)) - bare_cpu
    cpu = {name: after - cpu[name] for name, after in house.cpu_s().items()}
    contender.go()
    assert house.client.fleet_requests.get(request.id).state == "done"
    assert_same_bits(house.database, bare.results())
    service.go()
    idle += [bystander.ask()[0] for _ in range(_IDLE_ROUNDS)]
    print({name: round(seconds, 1) for name, seconds in (cpu | {"bare": bare_cpu}).items()}, file=sys.stderr)
    done = vehicles + disturbed
    cost_s = {name: seconds / done for name, seconds in cpu.items()}
    scales = scaled(cost_s, seed)
    print(*(" ".join(map(str, scale)) for scale in (Scale._fields, *scales)), sep="\n", file=sys.stderr)
    figures = {
        "vehicles_per_s": done / service.seconds,
        "bare_vehicles_per_s": vehicles / contender.seconds,
        "ratio_to_bare_by_cpu": (sum(cpu.values()) / done) / (bare_cpu / vehicles),
        "bystander_idle_s": statistics.median(idle),
        "bystander_s": statistics.median(bystander.seconds),
    }
    rounded = {name: round(value, 4) for name, value in figures.items()}
    cost_ms = {name: round(1e3 * seconds, 2) for name, seconds in cost_s.items()}
    cost_ms["bare"] = round(1e3 * bare_cpu / vehicles, 2)
    return {"vehicles": vehicles, **rounded, "cost_ms": cost_ms, "same_bits": True, "seed": seed}


def _take_turns(
    house: House,
    request_id: UUID,
    vehicles: int,
    service: Contender,
    bare: Contender,
    bystander: Asker,
) -> int:
    """Until both have done everything; how many bystanders' vehicles the service did besides."""
    every = max(1, vehicles // 10)
    asked = 0
    while not (service.is_done() and bare.is_done()):
        left = _left(house.database, request_id)
        # Not at the very end, where nobody is in the way any more.
        if vehicles - left >= every * (asked + 1) and left > every:
            asked += 1
            bystander.begin()
        if left:
            service.turn(stay=lambda: bystander.is_waiting)
        if not bare.is_done():
            bare.turn()
    return asked


def _left(database: Database, request_id: UUID) -> int:
    with database.reading() as session:
        of_request = FleetRequestVehicle.fleet_request_id == request_id
        return session.scalar(select(func.count()).where(of_request, FleetRequestVehicle.state == "queued")) or 0


def _asked_for(request_id: UUID) -> ColumnElement[bool]:
    vehicles = select(FleetRequestVehicle.calibration_id).where(FleetRequestVehicle.fleet_request_id == request_id)
    return CalibrationRun.calibration_id.in_(vehicles)


def _count(database: Database, request_id: UUID) -> int:
    with database.reading() as session:
        return session.scalars(select(func.count()).where(_asked_for(request_id))).one()


def main() -> None:
    figures = measure(int(os.environ.get("VEHICLES", "1000")), int(os.environ.get("SEED") or secrets.randbits(31)))
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
