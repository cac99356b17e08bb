"""`python -m benchmarks.growth`: what costs how much more as a service grows (SHORT=1 for smaller sizes).

ONLY=walks,pairs,retention,fleets measures parts; DATABASE=sqlite on SQLite.

Each measurement is done at three sizes through the real service (API, PostgreSQL that syncs, broker, one pool
process), the two largest tenfold apart. The exponent between these is the logarithm of the ratio of their seconds:
1 where ten times as much takes ten times as long. The last line is JSON.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any, NamedTuple
from uuid import UUID

import numpy as np
from sqlalchemy import func, select

from apexcal.regions import read_region
from apexcal.rigs import read_rig
from benchmarks.demo.annotators import mark_everything
from benchmarks.demo.truth import Truth
from benchmarks.growth.vehicles import bring_many
from benchmarks.house import House
from benchmarks.vehicles import draw, one_vehicle
from service.platform.db.clock import utc_now
from service.platform.db.fleet_requests import FleetRequestVehicle
from service.platform.db.recordings import Recording
from service.recordings.retention import delete_overdue

_PATIENCE_S = 600
_PAUSE_S = 0.02
Figures = dict[str, dict[int, float]]


class _Sizes(NamedTuple):
    """Seconds of a walk, pairs of a set, vehicles of a fleet, recordings whose retention has ended."""

    seconds: tuple[int, ...]
    pairs: tuple[int, ...]
    vehicles: tuple[int, ...]
    recordings: tuple[int, ...]


LONG = _Sizes((3, 6, 60), (3_000, 10_000, 100_000), (100, 500, 5_000), (30, 100, 1_000))
SHORT = _Sizes((2, 3, 30), (1_000, 3_000, 30_000), (20, 60, 600), (10, 30, 300))


def exponent(figures: dict[int, float]) -> float:
    """The power of the size by which the seconds grow between the two largest sizes."""
    (_, (small, few_s), (large, many_s)) = sorted(figures.items())
    return math.log(many_s / few_s) / math.log(large / small)


def _timed(action: Callable[[], Any]) -> tuple[float, Any]:
    began = time.perf_counter()
    answer = action()
    return time.perf_counter() - began, answer


def _walks(house: House, folder: Path, sizes: tuple[int, ...], figures: Figures) -> None:
    """Ingest, detect and mark simulated walks."""
    fleet = house.client.fleets.create("walks")
    for seconds in sizes:
        walk = folder / f"walk{seconds}"
        simulate = [sys.executable, "-m", "workers.simulation", "--out", str(walk), "--seconds", str(seconds)]
        subprocess.run(simulate, check=True, stdout=subprocess.DEVNULL)
        vehicle = house.client.vehicles.create(fleet.id, f"of {seconds} s")
        rig = house.client.vehicles.create_rig(vehicle.id, read_rig(walk / "rig.json", "front"))
        uploaded = house.client.recordings.upload(walk / "recording.bag", vehicle.id, rig.id)
        figures["ingest"][seconds], recording = _timed(
            lambda row=uploaded: house.client.wait(row, timeout_s=_PATIENCE_S)
        )
        asked = house.client.detections.create(recording.id, read_region(walk / "region.json"))
        figures["detection"][seconds], detection = _timed(
            lambda row=asked: house.client.wait(row, timeout_s=_PATIENCE_S)
        )
        truth = Truth(walk / "truth.json")
        figures["marking"][seconds], _ = _timed(
            lambda row=detection, truth=truth: mark_everything(
                house.client, fleet.id, row, "front", truth, lambda share, message: None
            )
        )


def _pairs(house: House, sizes: tuple[int, ...], figures: Figures) -> None:
    """Import sets of pairs, and read them back."""
    rig_id = one_vehicle(house.client, "pairs", draw(1, 1)[0]).rig
    random = np.random.default_rng(1)
    for count in sizes:
        rows = np.column_stack([random.uniform(2, 9, (count, 3)), random.uniform(0, 600, (count, 2))]).tolist()
        pairs = [dict(zip("xyzuv", row, strict=True)) for row in rows]
        figures["pairs in"][count], pair_set = _timed(
            lambda pairs=pairs: house.client.correspondence_sets.import_pairs(rig_id, "camera", pairs)
        )
        figures["pairs out"][count], _ = _timed(
            lambda row=pair_set: house.client._http.send("GET", f"/correspondence-sets/{row.id}").content
        )


def _fleets(house: House, sizes: tuple[int, ...], figures: Figures, extra: dict[str, Any]) -> None:
    """Ask for calibrations of whole fleets beside another writer, and read a page of vehicles."""
    house.restart_worker(0)
    for count in sizes:
        fleet = house.client.fleets.create(f"fleet of {count}")
        bring_many(house, fleet.id, count, count)
        page = f"/fleets/{fleet.id}/vehicles?limit=100"
        figures["list"][count] = min(
            _timed(lambda page=page: house.client._http.send("GET", page).content)[0] for _ in range(5)
        )
        with _writing(house, fleet.id) as writes_s:
            began = time.perf_counter()
            request = house.client.fleet_requests.create(fleet.id, {"name": "vehicle *"}, models=["pinhole"], folds=0)
            while _due(house, request.id):
                time.sleep(0.2)
            figures["fleet request"][count] = time.perf_counter() - began
        extra[f"longest write beside {count} vehicles, s"] = round(max(writes_s), 2)
        house.client.fleet_requests.cancel(request.id)


def _due(house: House, request_id: UUID) -> int:
    """Vehicles of a request whose calibration is not made."""
    vehicle = FleetRequestVehicle
    due = select(func.count()).where(vehicle.fleet_request_id == request_id, vehicle.calibration_id.is_(None))
    with house.database.reading() as session:
        return session.scalar(due) or 0


@contextmanager
def _writing(house: House, fleet_id: UUID) -> Iterator[list[float]]:
    """Make vehicles of the same fleet again and again meanwhile; how long each took."""
    seconds: list[float] = []
    enough = threading.Event()

    def write() -> None:
        while not enough.wait(_PAUSE_S):
            seconds.append(_timed(lambda: house.client.vehicles.create(fleet_id, f"other {len(seconds)}"))[0])

    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    try:
        yield seconds
    finally:
        enough.set()
        thread.join(60)


def _retention(house: House, sizes: tuple[int, ...], figures: Figures) -> None:
    """Delete recordings at the end of their retention."""
    one = one_vehicle(house.client, "ended", draw(1, 2)[0])
    of_rig = {"fleet_id": one.fleet, "vehicle_id": one.vehicle, "rig_id": one.rig, "file_name": "f"}
    for count in sizes:
        with house.database.writing() as session:
            ended = utc_now() - timedelta(days=1)
            session.add_all(
                Recording(**of_rig, name=f"walk {n}", state="ready", retain_until=ended) for n in range(count)
            )
        figures["retention"][count], deleted = _timed(lambda: delete_overdue(house.database))
        assert deleted == count


def main() -> None:
    """Measure, and print."""
    sizes = SHORT if os.environ.get("SHORT") else LONG
    only = os.environ.get("ONLY", "walks,pairs,retention,fleets").split(",")
    figures: Figures = defaultdict(dict)
    extra: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="apexcal-growth-") as folder:
        database: Any = os.environ.get("DATABASE", "postgresql")
        house = House(Path(folder) / "data", processes=1, database=database)
        parts: dict[str, Callable[[], None]] = {
            "walks": lambda: _walks(house, Path(folder), sizes.seconds, figures),
            "pairs": lambda: _pairs(house, sizes.pairs, figures),
            "retention": lambda: _retention(house, sizes.recordings, figures),
            "fleets": lambda: _fleets(house, sizes.vehicles, figures, extra),
        }
        try:
            for name in only:
                parts[name]()
        finally:
            house.close()
    for name, measured in figures.items():
        row = ", ".join(f"{size:,}: {seconds:.2f} s" for size, seconds in measured.items())
        print(f"{name:14} {row}; exponent {exponent(measured):.2f}", file=sys.stderr)
    exponents = {name: round(exponent(measured), 2) for name, measured in figures.items()}
    print(json.dumps({"exponents": exponents, "seconds": figures, **extra}))


if __name__ == "__main__":
    main()
