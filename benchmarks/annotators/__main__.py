"""`python -m benchmarks.annotators`: people who mark one recording at once. SHORT=1 for a short form.

One recording of 1,062 vertices, three marks each; 1, 10, 40 and 100 annotators who think for 0.2 to 0.5 s and have
two vertices ahead, without and with 40 open pages; SQLite and PostgreSQL; one API process. A bystander of another
fleet lists recordings meanwhile. A run ends after SECONDS (20), and a last one, of 25 people who do not think, when
nothing is left. Each prints a line of JSON: answers a second, milliseconds of taking and answering, the API's
processor milliseconds for an answer with all that its page asks, the bystander's 95th percentile, refusals, and what
is wrong with what is stored. ``machine_load`` tells how far to trust what depends on time.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any
from uuid import UUID

import httpx
from sqlalchemy import func, insert, select

from apexcal.embedded import plans
from apexcal.embedded.folder import DataFolder
from service.platform.auth.credential_actions import TOKEN_PREFIX, new_secret, secret_hash
from service.platform.db.annotations import Answer, MarkingProgress
from service.platform.db.base import new_id
from service.platform.db.fleets import Fleet
from service.platform.db.migrate import upgrade
from service.platform.db.people import ApiToken, Membership, Person
from service.platform.db.session import Database
from tests.service.detections.seeding import Seed, seed_marking
from tests.support.broker import Broker
from tests.support.postgres import Postgres
from tests.support.processes import free_port, start, stop_all, wait_until

_TICKS = os.sysconf("SC_CLK_TCK")
_MARKS = 3
# A person follows with twelve streams at most.
_PAGES_OF_A_PERSON = 10


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def _fleets(database: Database) -> list[UUID]:
    fleets = [Fleet(id=new_id(), name=name) for name in ("annotators", "bystander")]
    with database.writing() as session:
        session.add_all(fleets)
    return [one.id for one in fleets]


def _people(database: Database, fleet_id: UUID, count: int) -> list[str]:
    """The tokens of annotators of a fleet."""
    people = [{"id": new_id(), "name": f"annotator {number}"} for number in range(count)]
    tokens = [new_secret(TOKEN_PREFIX) for _ in people]
    both = list(zip(people, tokens, strict=True))
    with database.writing() as session:
        session.execute(insert(Person), people)
        member = {"fleet_id": fleet_id, "role": "annotator"}
        session.execute(insert(Membership), [member | {"person_id": one["id"]} for one in people])
        session.execute(
            insert(ApiToken),
            [{"person_id": one["id"], "name": "bench", "secret_hash": secret_hash(token)} for one, token in both],
        )
    return tokens


def wrong(database: Database, seed: Seed, *, accepted: int, is_drained: bool) -> list[str]:
    """What of the stored answers is not exact; see the module."""
    with database.reading() as session:
        pairs = session.execute(select(Answer.apex_id, Answer.person_id).where(Answer.is_verdict)).all()
        answers = session.scalar(select(func.count()).select_from(Answer)) or 0
        marks = session.scalar(select(func.count()).where(Answer.is_mark)) or 0
        sums = [func.sum(getattr(MarkingProgress, name)) for name in ("answered", "complete", "mine")]
        counted = session.execute(select(*sums).where(MarkingProgress.detection_id == seed.detection_id)).one()
    of_vertex = Counter(apex for apex, _ in pairs)
    counts = [of_vertex[apex] for apex in seed.apexes]
    complete = sum(count >= _MARKS for count in counts)
    found = [
        (max(counts) > _MARKS, f"a vertex has {max(counts)} answers"),
        (len(set(pairs)) < len(pairs), "somebody answered a vertex twice"),
        (is_drained and min(counts) < _MARKS, f"a vertex has {min(counts)} answers"),
        (not len(pairs) == answers == marks == accepted, f"{len(pairs)}, {answers}, {marks} of {accepted} answers"),
        (tuple(counted) != (len(of_vertex), complete, len(pairs)), f"the counters say {tuple(counted)}"),
    ]
    return [text for is_wrong, text in found if is_wrong]


def measure(
    kind: str,
    annotators: int,
    pages: int,
    *,
    seconds: float = 1e6,
    vertices: int = 1062,
    think_s: tuple[float, float] = (0.2, 0.5),
    seed: int = 1,
) -> dict[str, Any]:
    """One run in a database and a process of its own."""
    postgres, broker = (Postgres(synced=True) if kind == "postgresql" else None), Broker()
    with tempfile.TemporaryDirectory(prefix="apexcal-annotators-") as root:
        folder = DataFolder(Path(root) / "data")
        folder.logs.mkdir(parents=True)
        url = postgres.create("apexcal") if postgres else f"sqlite:///{folder.root}/apexcal.db"
        upgrade(url)
        database = Database(url)
        port = free_port()
        environment = {**os.environ, "APEXCAL_DATABASE_URL": url, "APEXCAL_DATA_DIR": str(folder.root)}
        environment |= {"APEXCAL_MIN_FREE_BYTES": "0", "APEXCAL_BROKER_URL": broker.url}
        child = start(list(plans.api(folder, environment, "127.0.0.1", port).command), folder.logs / "api.log",
                      env=environment)  # fmt: skip
        try:
            wait_until(lambda: _answers(child, port), "the start of the API", 120)
            # Not before: an API does not begin with rows whose recordings are nowhere.
            ours, other = _fleets(database)
            rows = seed_marking(database, ours, vertices=vertices, marks_per_vertex=_MARKS)
            tokens = _people(database, rows.fleet_id, annotators)
            readers = _people(database, rows.fleet_id, 1 + pages // _PAGES_OF_A_PERSON)
            (bystander,) = _people(database, other, 1)
            if _asked(port, "/v1/me", bystander) != 200:
                raise RuntimeError(f"Another program answers at port {port}.")
            plan = {
                "port": port, "detection": str(rows.detection_id), "fleet": str(rows.fleet_id), "seconds": seconds,
                "annotators": tokens, "pages": [readers[i % len(readers)] for i in range(pages)],
                "bystander": bystander, "think_s": think_s, "seed": seed,
            }  # fmt: skip
            before = _cpu_s(child.pid)
            ran = subprocess.run(
                [sys.executable, "-m", "benchmarks.annotators.load"],
                input=json.dumps(plan), capture_output=True, text=True, check=False,
            )  # fmt: skip
            if ran.returncode:
                raise RuntimeError(ran.stderr[-2000:])
            spent = _cpu_s(child.pid) - before
            found = json.loads(ran.stdout)
            accepted = found["accepted"]
            if not accepted:
                raise RuntimeError(
                    f"No answer was accepted: {found['statuses']}\n{(folder.logs / 'api.log').read_text()[-2000:]}"
                )
            is_drained = seconds >= 1e6
            return {
                "database": kind, "annotators": annotators, "pages": pages,
                "answers_a_second": round(accepted / found["seconds"], 1),
                **{f"{name}_ms": _percentiles(found["ms"][name]) for name in ("take", "answer", "bystander")},
                "cpu_ms_an_answer": round(1000.0 * spent / accepted, 1),
                "refused": {status: n for status, n in found["statuses"].items() if int(status) >= 300},
                "wrong": wrong(database, rows, accepted=accepted, is_drained=is_drained),
                "machine_load": round(os.getloadavg()[0], 1),
            }  # fmt: skip
        finally:
            stop_all([child])
            database.close()
            broker.stop()
            if postgres:
                postgres.close()


def _answers(child: subprocess.Popen[bytes], port: int) -> bool:
    assert child.poll() is None, "the API ended"
    return _asked(port, "/healthz") == 200


def _asked(port: int, path: str, token: str = "") -> int:
    """The status of an answer; 0 where nobody listens."""
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    try:
        return httpx.get(f"http://127.0.0.1:{port}{path}", headers=headers).status_code
    except httpx.TransportError:
        return 0


def _percentiles(ms: list[float]) -> dict[str, float]:
    cuts = statistics.quantiles(ms, n=100, method="inclusive") if len(ms) > 1 else ms * 99
    return {"p50": round(cuts[49], 1), "p95": round(cuts[94], 1)}


def main() -> None:
    """All runs."""
    short = bool(os.environ.get("SHORT"))
    seconds = float(os.environ.get("SECONDS", "6" if short else "20"))
    seed = int(os.environ.get("SEED", "1"))
    for kind in ("postgresql", "sqlite"):
        for annotators in (10, 40) if short else (1, 10, 40, 100):
            for pages in (0, 40):
                print(json.dumps(measure(kind, annotators, pages, seconds=seconds, seed=seed)), flush=True)
        drained = measure(kind, 25, 0, vertices=60 if short else 600, think_s=(0.0, 0.0), seed=seed)
        print(json.dumps({"drained": True} | drained), flush=True)


if __name__ == "__main__":
    main()
