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
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any, Literal

from sqlalchemy import func, select

from benchmarks.house import House, percentile
from service.platform.db.annotations import Answer, MarkingProgress
from service.platform.db.session import Database
from tests.service.detections.seeding import Seed, seed_marking

_MARKS = 3
# A person follows with twelve streams at most.
_PAGES_OF_A_PERSON = 10
_ASKED = ("take", "answer", "bystander")


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
    kind: Literal["postgresql", "sqlite"],
    annotators: int,
    pages: int,
    *,
    seconds: float = 1e6,
    vertices: int = 1062,
    think_s: tuple[float, float] = (0.2, 0.5),
    seed: int = 1,
) -> dict[str, Any]:
    """One run in a database and a process of its own."""
    with tempfile.TemporaryDirectory(prefix="apexcal-annotators-") as root:
        house = House(Path(root) / "data", 0, kind)
        try:
            ours, other = (house.client.fleets.create(name).id for name in ("annotators", "bystander"))
            rows = seed_marking(house.database, ours, vertices=vertices, marks_per_vertex=_MARKS)
            readers = [house.person(ours, "annotator") for _ in range(1 + pages // _PAGES_OF_A_PERSON)]
            plan = {
                "port": house.port, "detection": str(rows.detection_id), "fleet": str(ours), "seconds": seconds,
                "annotators": [house.person(ours, "annotator") for _ in range(annotators)],
                "pages": [readers[i % len(readers)] for i in range(pages)],
                "bystander": house.person(other, "annotator"), "think_s": think_s, "seed": seed,
            }  # fmt: skip
            before = house.cpu_s()["api"]
            ran = subprocess.run(
                [sys.executable, "-m", "benchmarks.annotators.load"],
                input=json.dumps(plan), capture_output=True, text=True, check=False,
            )  # fmt: skip
            if ran.returncode:
                raise RuntimeError(ran.stderr[-2000:])
            spent = house.cpu_s()["api"] - before
            load = json.loads(ran.stdout)
            accepted = load["accepted"]
            return {
                "database": kind, "annotators": annotators, "pages": pages,
                "answers_a_second": round(accepted / load["seconds"], 1),
                **{f"{name}_p95_ms": round(percentile(load["ms"][name], 0.95), 1) for name in _ASKED},
                "cpu_ms_an_answer": round(1000.0 * spent / max(accepted, 1), 1),
                "refused": {status: n for status, n in load["statuses"].items() if int(status) >= 300},
                "wrong": wrong(house.database, rows, accepted=accepted, is_drained=seconds >= 1e6),
                "machine_load": round(os.getloadavg()[0], 1),
            }  # fmt: skip
        finally:
            house.close()


def main() -> None:
    """All runs."""
    short = bool(os.environ.get("SHORT"))
    seconds = float(os.environ.get("SECONDS", "6" if short else "20"))
    seed = int(os.environ.get("SEED", "1"))
    databases: tuple[Literal["postgresql", "sqlite"], ...] = ("postgresql", "sqlite")
    for kind in databases:
        for annotators in (10, 40) if short else (1, 10, 40, 100):
            for pages in (0, 40):
                print(json.dumps(measure(kind, annotators, pages, seconds=seconds, seed=seed)), flush=True)
        drained = measure(kind, 25, 0, vertices=60 if short else 600, think_s=(0.0, 0.0), seed=seed)
        print(json.dumps({"drained": True} | drained), flush=True)


if __name__ == "__main__":
    main()
