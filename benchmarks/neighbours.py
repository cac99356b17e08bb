"""`python -m benchmarks.neighbours`: a quiet fleet beside a noisy one and a stranger. SHORT=1 for a short form.

One API process that may have 1 GiB of data and stacks, on either database. The noisy fleet's engineer imports sets
of 100,000 pairs, asks for calibrations of them, and lets 63 parts of uploads trickle; its viewer reads such sets and,
over 20 connections, one frame of 120 MB, half of them slowly; a stranger holds connections, half heads and half
sign-ins and sends made-up tokens. All of that comes from another process. The quiet fleet lists, reads and writes.

Each database prints a line of JSON. It ends with 1 where the quiet fleet waited for LIMIT_S (1) seconds (99 of 100
requests) or got a 5xx, where the noisy got one that is no 503, or where the API did not live through it.
"""

from __future__ import annotations

import json
import os
import random
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit
from uuid import UUID

import httpx

from benchmarks.house import House, percentile
from benchmarks.vehicles import draw, one_vehicle
from service.platform.auth.credential_actions import TOKEN_PREFIX, new_secret
from service.platform.db.fleets import Rig
from service.platform.db.recordings import Blob, CameraFrame, Recording, Sensor
from service.platform.storage.store import Store
from tests.support.rows import add
from tests.support.uploads import digest

_API_BYTES = 1 << 30
_PAIRS = 100_000
_FRAME_BYTES = 120_000_000
_VIEWERS, _TRICKLES, _SILENT = 20, 63, 200
_QUIET_PAUSE_S = 0.05
_PART_BYTES = 64 << 20


def small_fleet(house: House, name: str, seed: int) -> dict[str, str]:
    """A fleet with one vehicle, its rig and a small set of pairs: ids as texts."""
    one = one_vehicle(house.client, name, draw(1, seed)[0])
    return {"fleet": str(one.fleet), "vehicle": str(one.vehicle), "rig": str(one.rig), "set": str(one.pairs)}


def _large_frame(house: House, fleet: dict[str, str]) -> str:
    """The address of a frame of 120 MB; it is no image, and nothing looks."""
    with house.database.writing() as session:
        recording = add(session, Recording, session.get_one(Rig, UUID(fleet["rig"])))
        blob = add(session, Blob, key=f"{recording.id}/front", size=_FRAME_BYTES)
        camera = add(session, Sensor, recording, blob_key=blob.key)
        add(session, CameraFrame, camera, length=_FRAME_BYTES)
        address = f"/recordings/{recording.id}/cameras/front/frames/0"
    Store(house.blobs).put_bytes(blob.key, random.randbytes(_FRAME_BYTES))
    return address


class _Load:
    """Threads that ask again and again until it is over; what they were answered, by who asks and what for."""

    def __init__(self, url: str, seconds: float) -> None:
        self.url = url
        self.statuses: Counter[str] = Counter()
        self._until = time.monotonic() + seconds
        self._threads: list[threading.Thread] = []

    @property
    def is_over(self) -> bool:
        """Whether nobody is to ask any more."""
        return time.monotonic() >= self._until

    def client(self, token: str) -> httpx.Client:
        """A connection of somebody."""
        headers = {"Authorization": f"Bearer {token}"}
        return httpx.Client(base_url=f"{self.url}/v1", headers=headers, timeout=120)

    def ask(self, what: str, call: Callable[[], httpx.Response]) -> httpx.Response | None:
        """Ask once and count the answer. Who is told to come later comes later."""
        try:
            answer = call()
        except Exception as error:
            self.statuses[f"{what} {type(error).__name__}"] += 1
            time.sleep(0.5)
            return None
        self.statuses[f"{what} {answer.status_code}"] += 1
        if answer.status_code >= 400:
            time.sleep(0.5)
        return answer

    def again(self, turn: Callable[[], object], times: int = 1) -> None:
        """Do this again and again, in threads."""

        def run() -> None:
            while not self.is_over:
                turn()

        self._threads += [threading.Thread(target=run, daemon=True) for _ in range(times)]

    def run(self) -> None:
        """Begin, and wait for the end."""
        for thread in self._threads:
            thread.start()
        for thread in self._threads:
            thread.join(180)


def _csv(count: int) -> bytes:
    """Pairs as a file."""
    draws = random.Random(count)
    rows = (f"{draws.uniform(2, 9)},{draws.uniform(-3, 3)},1,{draws.uniform(0, 600)},300,1" for _ in range(count))
    return "\n".join(["x,y,z,u,v,group", *rows, ""]).encode()


def _import(client: httpx.Client, rig: str, content: bytes) -> httpx.Response:
    path = f"/rigs/{rig}/correspondence-sets?camera=camera"
    return client.post(path, content=content, headers={"Content-Type": "text/csv"})


def _engineer(load: _Load, token: str, fleet: dict[str, str]) -> None:
    client, large = load.client(token), _csv(_PAIRS - 1)
    head, _, rest = large.partition(b"\n")
    sets = [fleet["large"]]

    def import_pairs() -> None:
        # Another content each time.
        content = b"%b\n5.%06d,1,1,2,3,1\n%b" % (head, random.randrange(10**6), rest)
        answer = load.ask("import", lambda: _import(client, fleet["rig"], content))
        if answer is not None and answer.status_code == 201:
            sets.append(answer.json()["id"])

    def calibrate() -> None:
        body = {"correspondence_set_ids": sets[-1:], "models": ["pinhole"], "seed": random.randrange(10**6)}
        answer = load.ask("calibrate", lambda: client.post(f"/vehicles/{fleet['vehicle']}/calibrations", json=body))
        if answer is not None and answer.status_code == 202:
            load.ask("cancel", lambda: client.post(f"/calibrations/{answer.json()['id']}/cancel"))

    def read() -> None:
        load.ask("read", lambda: client.get(f"/correspondence-sets/{sets[-1]}"))

    load.again(import_pairs, 3)
    load.again(calibrate, 3)
    load.again(read, 3)


def _trickle(load: _Load, token: str, fleet: dict[str, str]) -> None:
    client, whole, numbers = load.client(token), digest(bytes(_PART_BYTES)), iter(range(1, 10**6))
    body = {"name": "trickle", "file_name": "trickle.bag", "rig_id": fleet["rig"]}
    recording = client.post(f"/vehicles/{fleet['vehicle']}/recordings", json=body).json()["id"]

    def bytes_of_a_part() -> Iterator[bytes]:
        while not load.is_over:
            yield b"0" * 1000
            time.sleep(1.0)

    def send() -> None:
        headers = {"Content-Digest": whole, "Content-Length": str(_PART_BYTES)}
        path = f"/recordings/{recording}/parts/{next(numbers)}"
        load.ask("trickle", lambda: client.put(path, content=bytes_of_a_part(), headers=headers))

    load.again(send, _TRICKLES)


def _viewer(load: _Load, token: str, fleet: dict[str, str], frame: str) -> None:
    def see(pause_s: float) -> None:
        def stream() -> httpx.Response:
            with load.client(token) as client, client.stream("GET", frame) as answer:
                for _ in answer.iter_bytes(1 << 16):
                    if load.is_over:
                        break
                    time.sleep(pause_s)
                return answer

        load.ask("frame", stream)

    client = load.client(token)
    load.again(lambda: load.ask("view", lambda: client.get(f"/correspondence-sets/{fleet['large']}")), 3)
    load.again(lambda: see(0.0), _VIEWERS // 2)
    load.again(lambda: see(0.5), _VIEWERS // 2)


def _stranger(load: _Load) -> None:
    where = urlsplit(load.url)
    half = b"POST /v1/sign-in HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\nContent-Length: 40\r\n\r\n{"

    def hold(first: bytes) -> None:
        with suppress(OSError), socket.create_connection((where.hostname, where.port), timeout=5) as silent:
            silent.sendall(first)
            while not load.is_over and silent.recv(4096):
                pass
        time.sleep(0.2)

    for first in (b"", b"GET /healthz HTTP/1.1\r\nX-", half):
        load.again(lambda first=first: hold(first), _SILENT // 4)
    client = load.client(new_secret(TOKEN_PREFIX))
    load.again(lambda: load.ask("stranger", lambda: client.get("/fleets")), 5)


def _make_noise(url: str, seconds: float, tokens: list[str], fleet: dict[str, str], frame: str) -> None:
    """What the other process does; it prints what it was answered."""
    # Elsewhere these would be other machines.
    os.nice(10)
    load = _Load(url, seconds)
    engineer, trickler, viewer = tokens
    _engineer(load, engineer, fleet)
    _trickle(load, trickler, fleet)
    _viewer(load, viewer, fleet, frame)
    _stranger(load)
    load.run()
    print(json.dumps(dict(sorted(load.statuses.items()))))


def _live_quietly(load: _Load, token: str, fleet: dict[str, str]) -> list[float]:
    """List, read and write as a fleet does on an ordinary day; the seconds of each request."""
    seconds: list[float] = []
    client, numbers = load.client(token), iter(range(random.randrange(10**9), 10**10))
    paths = (f"/fleets/{fleet['fleet']}/vehicles", f"/correspondence-sets/{fleet['set']}", f"/rigs/{fleet['rig']}")

    def turn(what: str, call: Callable[[], httpx.Response]) -> None:
        began = time.perf_counter()
        load.ask(what, call)
        seconds.append(time.perf_counter() - began)
        time.sleep(_QUIET_PAUSE_S)

    def read() -> None:
        for path in paths:
            turn("read", lambda path=path: client.get(path))

    def write() -> None:
        body = {"name": f"vehicle {next(numbers)}"}
        turn("write", lambda: client.post(f"/fleets/{fleet['fleet']}/vehicles", json=body))

    load.again(read, 2)
    load.again(write)
    load.run()
    return seconds


def measure(database: Literal["postgresql", "sqlite"], seconds: float) -> dict[str, Any]:
    """What the quiet fleet and the noisy ones were answered, and what the API took."""
    with tempfile.TemporaryDirectory(prefix="apexcal-neighbours-") as folder:
        house = House(Path(folder) / "data", processes=1, database=database, api_bytes=_API_BYTES)
        try:
            noisy, quiet = small_fleet(house, "noisy", 1), small_fleet(house, "quiet", 2)
            frame = _large_frame(house, noisy)
            tokens = [house.person(UUID(noisy["fleet"]), role) for role in ("engineer", "engineer", "viewer")]
            with _Load(house.address, 0.0).client(tokens[0]) as client:
                noisy["large"] = _import(client, noisy["rig"], _csv(_PAIRS)).json()["id"]
            engineer = house.person(UUID(quiet["fleet"]), "engineer")
            alone = _live_quietly(_Load(house.address, seconds / 4), engineer, quiet)
            noise = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.neighbours", "noise"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
            assert noise.stdin
            noise.stdin.write(json.dumps([house.address, seconds, tokens, noisy, frame]).encode())
            noise.stdin.close()
            load = _Load(house.address, seconds)
            beside = _live_quietly(load, engineer, quiet)
            assert noise.stdout
            statuses = json.loads(noise.stdout.read())
            noise.wait(60)
            return {
                "database": database,
                "seconds": seconds,
                "requests": len(beside),
                "alone_p99_s": round(percentile(alone, 0.99), 3),
                "p99_s": round(percentile(beside, 0.99), 3),
                "quiet": dict(sorted(load.statuses.items())),
                "noisy": statuses,
                "api_peak_mib": house.api_peak_mib(),
                "machine_load": os.getloadavg()[0],
            }
        finally:
            house.close()


def broken(figures: dict[str, Any]) -> list[str]:
    """The promises that were not kept, in words."""
    quiet = [status for status in figures["quiet"] if status.split()[1] not in ("200", "201")]
    noisy = [
        status for status in figures["noisy"] if status.split()[1].startswith("5") and not status.endswith("503")
    ]
    limit_s = float(os.environ.get("LIMIT_S", "1"))
    return [
        *([f"the quiet fleet waited {figures['p99_s']} s"] if figures["p99_s"] >= limit_s else []),
        *(f"the quiet fleet: {status}" for status in quiet),
        *(f"the noisy: {status}" for status in noisy),
        *(["the API ended"] if figures["api_peak_mib"] is None else []),
    ]


def main() -> int:
    """Measure both databases, or be the noise."""
    if sys.argv[1:] == ["noise"]:
        _make_noise(*json.load(sys.stdin))
        return 0
    seconds = 20.0 if os.environ.get("SHORT") else 120.0
    failures = 0
    databases: tuple[Literal["postgresql", "sqlite"], ...] = ("postgresql", "sqlite")
    for database in databases:
        figures = measure(database, seconds)
        figures["broken"] = broken(figures)
        failures += len(figures["broken"])
        print(json.dumps(figures), flush=True)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
