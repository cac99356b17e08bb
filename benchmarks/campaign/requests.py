"""The distinct requests of the campaign, and what each gives when nothing disturbs it."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from apexcal.rigs import read_rig
from service.platform.db.models import Detection, Recording, Sensor, Vertex
from service.platform.storage.store import Store
from tests.faults.jobs import REGION, Walk
from tests.faults.results import Documents

Json = dict[str, Any]

# From a few slots to some seconds of them, in each way of farming, with and without held-out pairs.
CALIBRATIONS: dict[str, Json] = {
    "pinhole by slots": {
        "models": ["pinhole"],
        "folds": 0,
        "farm": "slots",
        "schedule": {"slots": 4, "population": 1000, "generations": 200, "max_iterations": 3},
    },
    "pinhole whole": {
        "models": ["pinhole"],
        "folds": 2,
        "farm": "runs",
        "schedule": {"slots": 3, "population": 800, "generations": 150, "max_iterations": 3},
    },
    "kannala_brandt as it comes": {
        "models": ["kannala_brandt"],
        "folds": 0,
        "farm": "auto",
        "schedule": {"slots": 6, "population": 800, "generations": 150, "max_iterations": 2},
    },
    "two models": {
        "models": ["pinhole", "brown_conrady"],
        "folds": 2,
        "farm": "slots",
        "publish": "recommended",
        "schedule": {"slots": 2, "population": 800, "generations": 100, "max_iterations": 2},
    },
}
REGION_OF_WALKS = REGION


def record(folder: Path, count: int) -> dict[str, Walk]:
    """Simulate ``count`` short recordings."""
    walks: dict[str, Walk] = {}
    for seed in range(count):
        out = folder / f"walk-{seed}"
        command = [sys.executable, "-m", "workers.simulation", "--out", str(out), "--seconds", "2"]
        subprocess.run([*command, "--seed", str(seed)], check=True, stdout=subprocess.DEVNULL)
        walks[out.name] = Walk(next(out.glob("*.bag")), read_rig(out / "rig.json", "roof"))
    return walks


@dataclass
class Expected:
    """What undisturbed work found, by request and by walk."""

    calibrations: dict[str, Documents] = field(default_factory=dict[str, Documents])
    recordings: dict[str, Json] = field(default_factory=dict[str, Json])
    detections: dict[str, list[Any]] = field(default_factory=dict[str, list[Any]])


def sensors(session: Session, store: Store, recording: Recording) -> Json:
    """What an ingestion made: facts, warnings, and the sensors with the SHA-256 of their bytes."""
    rows = session.scalars(select(Sensor).where(Sensor.recording_id == recording.id).order_by(Sensor.name))
    return {
        "facts": recording.facts,
        "warnings": recording.warnings,
        "sensors": [(row.name, row.count, row.facts, sha256_of(store, [row.blob_key])) for row in rows],
    }


def vertices(session: Session, detection: Detection) -> list[Any]:
    """What a detection found."""
    rows = session.scalars(select(Vertex).where(Vertex.detection_id == detection.id).order_by(Vertex.rank))
    found = [(row.rank, row.sweep_index, row.time_ns, row.x, row.y, row.z, row.ring, row.points) for row in rows]
    return [detection.counts, *found]


def sha256_of(store: Store, keys: list[str]) -> str:
    """The SHA-256 of objects, joined."""
    digest = hashlib.sha256()
    for key in keys:
        for chunk in store.stream(key):
            digest.update(chunk)
    return digest.hexdigest()
