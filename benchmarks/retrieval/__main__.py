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
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any
from uuid import UUID

import httpx
from sqlalchemy import text

from benchmarks.house import House, percentile
from benchmarks.retrieval.load import WARM_S
from benchmarks.retrieval.served import EMPTY
from benchmarks.retrieval.vehicles import CAMERAS, make

_VERSIONS = 10
Asks = list[tuple[str, str]]


class Load:
    """A process that asks at a rate."""

    def __init__(self, house: House, token: str, asks: Asks, rate: float, seconds: float) -> None:
        self._house, self._cpu_s = house, house.cpu_s()["api"]
        self._count = rate * (seconds + WARM_S)
        plan = {"port": house.port, "token": token, "rate": rate, "seconds": seconds, "asks": asks}
        command = [sys.executable, "-m", "benchmarks.retrieval.load"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._process.stdin
        self._process.stdin.write(json.dumps(plan).encode())
        self._process.stdin.close()

    def figures(self) -> dict[str, float]:
        """Milliseconds, and the API's processor microseconds for each request. Raises where one failed."""
        assert self._process.stdout
        answer = json.loads(self._process.stdout.read())
        self._process.wait(60)
        if len(answer["statuses"]) != 1 or not {"200", "204", "304"} & {*answer["statuses"]}:
            raise RuntimeError(f"{answer['statuses']}")
        spent = (self._house.cpu_s()["api"] - self._cpu_s) / self._count
        return {f"p{n}_ms": percentile(answer["ms"], n / 100) for n in (50, 99)} | {"cpu_us": 1e6 * spent}


def _asks(vehicles: list[UUID], draw: random.Random, count: int, etags: dict[UUID, str] | None = None) -> Asks:
    chosen = draw.choices(list(etags or vehicles), k=count)
    return [(f"/vehicles/{one}/calibration", etags[one] if etags else "") for one in chosen]


def _stale(
    house: House, clients: list[httpx.Client], vehicles: list[UUID], draw: random.Random, publications: int
) -> int:
    """Answers after a publication's 201 that are older than it, of both processes, with and without an ETag."""
    stale = 0
    for number in range(publications):
        vehicle, camera = draw.choice(vehicles[:50]), draw.choice(CAMERAS)
        before = clients[number % 2].get(f"/vehicles/{vehicle}/calibration")
        now = before.json()["cameras"][camera]["result_id"]
        with house.database.reading() as session:
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
    with tempfile.TemporaryDirectory(prefix="apexcal-retrieval-") as folder:
        house = House(Path(folder) / "data", 0, app="benchmarks.retrieval.served:create_app")
        try:
            fleet = house.client.fleets.create("vehicles").id
            ids, token = make(house.database, fleet, vehicles, _VERSIONS), house.person(fleet, "admin")
            headers = {"Authorization": f"Bearer {token}"}
            clients = [
                httpx.Client(base_url=f"{address}/v1", headers=headers)
                for address in (house.address, house.another_api())
            ]
            some = draw.sample(ids, min(500, vehicles))
            etags = {one: clients[0].get(f"/vehicles/{one}/calibration").headers["ETag"] for one in some}
            empty = Load(house, token, [(EMPTY.removeprefix("/v1"), "")], 1000, seconds).figures()
            unchanged = Load(house, token, _asks(ids, draw, 20_000, etags), 1000, seconds).figures()
            whole = Load(house, token, _asks(ids, draw, 20_000), 50, seconds).figures()
            beside = Load(house, token, _asks(ids, draw, 5_000), 50, seconds)
            stale = _stale(house, clients, ids, draw, publications)
            beside.figures()
        finally:
            house.close()
    return {
        "empty_cpu_us": round(empty["cpu_us"]),
        "not_modified_cpu_us": round(unchanged["cpu_us"]),
        "not_modified_cpu_over_empty_route": round(unchanged["cpu_us"] / empty["cpu_us"], 2),
        "not_modified_p99_ms": round(unchanged["p99_ms"], 2),
        "whole_vehicle_p99_ms_at_50": round(whole["p99_ms"], 2),
        "stale_answers": stale,
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
