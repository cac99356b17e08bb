"""`python -m benchmarks.flood`: a quiet fleet beside a viewer who has much parsed. SHORT=1 for a short form.

SQLite with one API process, PostgreSQL with two. Over 64 connections to each API a viewer of another fleet posts
60 kB, and again after each answer: YAML to `calibration-files/reading`, a URDF to `rig-proposals`, in turns. That
comes from another process. Meanwhile the quiet fleet reads 1,000 times over three connections and writes
300 times over another, its requests to the APIs in turns.

Each database prints a line of JSON. It ends with 1 where one of 100 reads or writes took LIMIT_S (0.3) seconds,
where the quiet fleet got anything but what it asked for, or where the viewer got a 5xx that is no 503.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from itertools import count, cycle
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit
from uuid import UUID

from benchmarks.connection import Connection
from benchmarks.house import House, percentile
from benchmarks.neighbours import small_fleet
from service.platform.db.fleets import Rig
from service.platform.db.recordings import Blob, Recording, Sensor
from tests.support.rows import add

_AT_ONCE = 64
_READERS = 3
_PAUSE_S = 0.02
# The flood has its first answers after so long, and its worst is under way.
_BEGUN_S = 5.0
_YAML = {"files": {"a.yaml": "a: [" + "{a}," * 14_990 + "]"}}
_LINK = (
    '<link name="l{0}"/><joint name="j{0}" type="fixed"><parent link="base"/><child link="l{0}"/>'
    '<origin xyz="0.1 0.2 {0}" rpy="0 0 0.1"/></joint>'
)
_URDF = {"urdf": f'<robot name="r"><link name="base"/>{"".join(map(_LINK.format, range(430)))}</robot>'}


def _recording(house: House, rig: str) -> str:
    """A recording with a LiDAR and a camera, for which rigs are proposed."""
    with house.database.writing() as session:
        recording = add(session, Recording, session.get_one(Rig, UUID(rig)))
        for name in ("lidar", "front"):
            blob = add(session, Blob, key=f"{recording.id}/{name}")
            add(
                session,
                Sensor,
                recording,
                kind="lidar" if name == "lidar" else "camera",
                name=name,
                blob_key=blob.key,
            )
        return str(recording.id)


async def _ask(connection: Connection, method: str, path: str, body: Any = None) -> int:
    """The status of an answer. Who asks too rarely finds the connection closed, and opens it again."""
    try:
        return (await connection.ask(method, path, body))[0]
    except (ConnectionError, asyncio.IncompleteReadError):
        await connection.open()
        return (await connection.ask(method, path, body))[0]


async def _flood(ports: list[int], token: str, recording: str) -> None:
    """Post again and again until this process is ended; it prints what was answered each second."""
    # Elsewhere this would be another machine.
    os.nice(10)
    statuses: Counter[str] = Counter()
    posts = [("/calibration-files/reading", _YAML), (f"/recordings/{recording}/rig-proposals", _URDF)]

    async def post(port: int, number: int) -> None:
        connection = Connection(port, token)
        await connection.open()
        for path, body in cycle(posts[number % 2 :] + posts[: number % 2]):
            status = await _ask(connection, "POST", path, body)
            statuses[f"{path.rpartition('/')[2]} {status}"] += 1

    async def say() -> None:
        while True:
            await asyncio.sleep(1.0)
            print(json.dumps(dict(sorted(statuses.items()))), flush=True)

    await asyncio.gather(say(), *(post(port, number) for port in ports for number in range(_AT_ONCE)))


async def _live_quietly(
    ports: list[int], token: str, fleet: dict[str, str], reads: int, writes: int
) -> dict[str, Any]:
    """Read and write as often; the seconds of each request, and what was answered."""
    paths = (f"/fleets/{fleet['fleet']}/vehicles", f"/correspondence-sets/{fleet['set']}", f"/rigs/{fleet['rig']}")
    seconds: dict[str, list[float]] = {"read": [], "write": []}
    statuses: Counter[str] = Counter()
    read_paths, names = cycle(paths), count(time.time_ns())

    async def ask(turns: Iterator[int], what: str) -> None:
        connections = [Connection(port, token) for port in ports]
        for connection in connections:
            await connection.open()
        for turn in turns:
            request = ("GET", next(read_paths), None)
            if what == "write":
                request = ("POST", paths[0], {"name": f"vehicle {next(names)}"})
            began = time.perf_counter()
            status = await _ask(connections[turn % len(ports)], *request)
            seconds[what].append(time.perf_counter() - began)
            statuses[f"{what} {status}"] += 1
            await asyncio.sleep(_PAUSE_S)

    read_turns = iter(range(reads))
    await asyncio.gather(*(ask(read_turns, "read") for _ in range(_READERS)), ask(iter(range(writes)), "write"))
    figures = {
        f"{what}_{name}_s": round(percentile(took, share), 3)
        for what, took in seconds.items()
        for name, share in (("p50", 0.5), ("p99", 0.99), ("max", 1.0))
    }
    return {"statuses": dict(sorted(statuses.items())), **figures}


def measure(database: Literal["postgresql", "sqlite"], reads: int, writes: int) -> dict[str, Any]:
    """What the quiet fleet waited, alone and beside the flood, and what the viewer was answered."""
    with tempfile.TemporaryDirectory(prefix="apexcal-flood-") as folder:
        house = House(Path(folder) / "data", processes=0, database=database)
        try:
            addresses = [house.address, *([house.another_api()] if database == "postgresql" else [])]
            ports = [urlsplit(address).port or 0 for address in addresses]
            noisy, quiet = small_fleet(house, "noisy", 1), small_fleet(house, "quiet", 2)
            recording = _recording(house, noisy["rig"])
            viewer, engineer = (
                house.person(UUID(noisy["fleet"]), "viewer"),
                house.person(UUID(quiet["fleet"]), "engineer"),
            )
            alone = asyncio.run(_live_quietly(ports, engineer, quiet, reads // 4, writes // 4))
            arguments = json.dumps([ports, viewer, recording])
            command = [sys.executable, "-m", "benchmarks.flood", arguments]
            flood = subprocess.Popen(command, stdout=subprocess.PIPE)
            time.sleep(_BEGUN_S)
            began = time.perf_counter()
            beside = asyncio.run(_live_quietly(ports, engineer, quiet, reads, writes))
            seconds = time.perf_counter() - began
            assert flood.poll() is None, "the flood ended early"
            flood.terminate()
            said, _ = flood.communicate(timeout=60)
            return {
                "database": database,
                "apis": len(ports),
                "seconds": round(seconds, 1),
                "alone": alone,
                "quiet": beside,
                "flood": json.loads(said.splitlines()[-1]),
                "machine_load": os.getloadavg()[0],
            }
        finally:
            house.close()


def broken(figures: dict[str, Any], limit_s: float) -> list[str]:
    """The promises that were not kept, in words."""
    quiet = figures["quiet"]
    failed = [status for status in figures["flood"] if status.split()[1].startswith("5") and "503" not in status]
    return [
        *(
            f"a {what} took {quiet[f'{what}_p99_s']} s"
            for what in ("read", "write")
            if quiet[f"{what}_p99_s"] >= limit_s
        ),
        *(f"the quiet fleet: {status}" for status in quiet["statuses"] if status not in ("read 200", "write 201")),
        *(f"the viewer: {status}" for status in failed),
    ]


def main() -> int:
    """Measure both databases, or be the flood."""
    if len(sys.argv) > 1:
        asyncio.run(_flood(*json.loads(sys.argv[1])))
    reads, writes = (100, 30) if os.environ.get("SHORT") else (1000, 300)
    failures = 0
    databases: tuple[Literal["postgresql", "sqlite"], ...] = ("postgresql", "sqlite")
    for database in databases:
        figures = measure(database, reads, writes)
        figures["broken"] = broken(figures, float(os.environ.get("LIMIT_S", "0.3")))
        failures += len(figures["broken"])
        print(json.dumps(figures), flush=True)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
