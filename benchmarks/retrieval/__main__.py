"""`python -m benchmarks.retrieval`: how fast a vehicle gets its calibration. SHORT=1 for a short form.

10,000 vehicles of two cameras with 10 publications each (SHORT: 1,000), PostgreSQL, one API process. An empty route,
304 of random vehicles at 1,000 requests a second, the whole vehicle at 50 a second. Then publications through one of
two API processes under load: after each 201 both are asked. Latency counts from when a request was due. The last line
is JSON; it includes the machine's load, which tells how far to trust the figures.
"""

from __future__ import annotations

import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import UUID

import httpx
from sqlalchemy import text

from apexcal.embedded import plans
from apexcal.embedded.children import ChildPlan
from apexcal.embedded.folder import DataFolder
from benchmarks.retrieval.served import EMPTY
from benchmarks.retrieval.vehicles import CAMERAS, Fleet, make
from service.platform.db.migrate import upgrade
from service.platform.db.session import Database
from tests.support.postgres import Postgres
from tests.support.processes import free_port, start, stop_all, wait_until

_VERSIONS = 10
_TICKS = os.sysconf("SC_CLK_TCK")


class Api:
    """An API process on a port."""

    def __init__(self, folder: DataFolder, environment: dict[str, str]) -> None:
        self.port = free_port()
        plan: ChildPlan = plans.api(folder, environment, "127.0.0.1", self.port)
        command = ["benchmarks.retrieval.served:create_app" if "create_app" in one else one for one in plan.command]
        self.child = start(command, folder.logs / f"api-{self.port}.log", env=environment)
        self.url = f"http://127.0.0.1:{self.port}/v1"
        wait_until(self._answers, "the start of the API", 60)

    def _answers(self) -> bool:
        try:
            return httpx.get(f"http://127.0.0.1:{self.port}/healthz").status_code == 200
        except httpx.TransportError:
            return False

    @property
    def cpu_s(self) -> float:
        """Processor seconds so far."""
        fields = Path(f"/proc/{self.child.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICKS


@contextmanager
def _house(vehicles: int) -> Iterator[tuple[list[Api], Database, Fleet]]:
    postgres = Postgres(synced=True)
    with tempfile.TemporaryDirectory(prefix="apexcal-retrieval-") as root:
        folder = DataFolder(Path(root) / "data")
        folder.logs.mkdir(parents=True)
        url = postgres.create("apexcal")
        upgrade(url)
        database = Database(url)
        fleet = make(database, vehicles, _VERSIONS)
        environment = {**os.environ, "APEXCAL_DATABASE_URL": url, "APEXCAL_DATA_DIR": str(folder.root)}
        environment |= {"APEXCAL_MIN_FREE_BYTES": "0", "APEXCAL_BROKER_URL": f"redis+socket://{folder.socket}"}
        apis: list[Api] = []
        try:
            apis += [Api(folder, environment) for _ in range(2)]
            yield apis, database, fleet
        finally:
            stop_all([one.child for one in apis])
            database.close()
            postgres.close()


def _load(api: Api, lines: list[str], rate: float, seconds: float) -> dict[str, float]:
    """Milliseconds at a rate, and the API's processor microseconds for each request. Raises where one failed."""
    before = api.cpu_s
    ran = subprocess.run(
        [sys.executable, "-m", "benchmarks.retrieval.load", str(api.port), str(rate), str(seconds)],
        input="\n".join(lines), capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = json.loads(ran.stdout)
    wrong = {status for status in found["statuses"] if status not in ("200", "204", "304")}
    if found["failures"] or wrong or len(found["statuses"]) != 1:
        raise RuntimeError(f"{found['statuses']}, {found['failures']} connections failed")
    spent = (api.cpu_s - before) / (rate * (seconds + 2.0))
    cuts = statistics.quantiles(found["ms"], n=100)
    return {"p50_ms": cuts[49], "p99_ms": cuts[98], "cpu_us": 1e6 * spent}


def _asks(fleet: Fleet, draw: random.Random, count: int, etags: dict[UUID, str] | None = None) -> list[str]:
    chosen = [draw.choice(list(etags or fleet.vehicles)) for _ in range(count)]
    return [f"/v1/vehicles/{one}/calibration {fleet.token} {etags[one] if etags else '-'}" for one in chosen]


def _etags(api: Api, fleet: Fleet, vehicles: list[UUID]) -> dict[UUID, str]:
    headers = {"Authorization": f"Bearer {fleet.token}"}
    with httpx.Client(base_url=api.url, headers=headers) as client:
        return {one: client.get(f"/vehicles/{one}/calibration").headers["ETag"] for one in vehicles}


def _stale(apis: list[Api], database: Database, fleet: Fleet, draw: random.Random, publications: int) -> int:
    """Answers after a publication's 201 that are older than it, of both processes, with and without an ETag."""
    headers = {"Authorization": f"Bearer {fleet.token}"}
    clients = [httpx.Client(base_url=one.url, headers=headers) for one in apis]
    stale = 0
    for number in range(publications):
        vehicle, camera = draw.choice(fleet.vehicles[:50]), draw.choice(CAMERAS)
        before = clients[number % 2].get(f"/vehicles/{vehicle}/calibration")
        now = before.json()["cameras"][camera]["result_id"]
        with database.reading() as session:
            others = session.scalars(
                text("SELECT DISTINCT result_id FROM publication WHERE vehicle_id = :v AND camera = :c"),
                {"v": vehicle, "c": camera},
            ).all()
        new = draw.choice([str(one) for one in others if str(one) != now])
        made = clients[number % 2].post(
            f"/results/{new}/publication", json={"override": {"reason": "For the measurement."}}
        )
        made.raise_for_status()
        for client in (*clients, *clients):
            conditional = {"If-None-Match": before.headers["ETag"]}
            answer = client.get(f"/vehicles/{vehicle}/calibration", headers=conditional)
            stale += answer.status_code != 200 or answer.json()["cameras"][camera]["result_id"] != new
    return stale


def measure(*, vehicles: int, seconds: float, publications: int, seed: int) -> dict[str, Any]:
    """All figures; see the module."""
    draw = random.Random(seed)
    with _house(vehicles) as (apis, database, fleet):
        api = apis[0]
        empty = [f"{EMPTY} {fleet.token} -"]
        some = draw.sample(fleet.vehicles, min(500, vehicles))
        etags = _etags(api, fleet, some)
        figures = {"empty": _load(api, empty, 1000, seconds)}
        figures["not_modified"] = _load(api, _asks(fleet, draw, 20_000, etags), 1000, seconds)
        figures["whole"] = _load(api, _asks(fleet, draw, 20_000), 50, seconds)
        beside = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.retrieval.load", str(api.port), "50", str(seconds)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert beside.stdin is not None
        beside.stdin.write("\n".join(_asks(fleet, draw, 5_000)))
        beside.stdin.close()
        stale = _stale(apis, database, fleet, draw, publications)
        beside.wait()
    for name, found in figures.items():
        print(f"{name:>14}: " + ", ".join(f"{key} {value:.2f}" for key, value in found.items()))
    return {
        "not_modified_p99_ms": round(figures["not_modified"]["p99_ms"], 2),
        "not_modified_over_empty_route": round(figures["not_modified"]["p50_ms"] / figures["empty"]["p50_ms"], 2),
        "whole_vehicle_p99_ms_at_50": round(figures["whole"]["p99_ms"], 2),
        "stale_answers": stale,
        "not_modified_p50_ms": round(figures["not_modified"]["p50_ms"], 2),
        "not_modified_cpu_over_empty_route": round(figures["not_modified"]["cpu_us"] / figures["empty"]["cpu_us"], 2),
        "publications": publications,
        "vehicles": vehicles,
        "machine_load": round(os.getloadavg()[0], 1),
        "seed": seed,
    }


if __name__ == "__main__":
    short = bool(os.environ.get("SHORT"))
    print(
        json.dumps(
            measure(
                vehicles=1_000 if short else 10_000,
                seconds=5.0 if short else 20.0,
                publications=40 if short else 200,
                seed=int(os.environ.get("SEED", "1")),
            )
        )
    )
