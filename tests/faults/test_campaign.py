"""The campaign in its short form, and a broken promise of each kind that its check must find."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy.orm import Session

from benchmarks.campaign.invariants import check
from benchmarks.campaign.ledger import Ledger
from benchmarks.campaign.requests import Expected
from service.platform.db.base import new_id
from service.platform.db.models import Blob, Fleet, Recording, Rig, UploadPart, Vehicle
from service.platform.storage.store import Store
from tests.support.databases import one_database
from tests.support.draws import DRAWS
from tests.support.folders import folder_store
from tests.support.rows import add

pytestmark = pytest.mark.faults


def other_bytes(session: Session, store: Store, ledger: Ledger) -> None:
    rig = add(session, Rig, add(session, Vehicle, add(session, Fleet, name="fleet")))
    recording = add(session, Recording, rig, state="failed")
    store.put_bytes("part", b"bytez")
    add(session, Blob, key="part", size=5)
    add(session, UploadPart, recording, number=1, blob_key="part", size=5, sha256="0" * 64)
    ledger.completed[recording.id] = "0" * 64


BROKEN: dict[str, Callable[[Session, Store, Ledger], object]] = {
    "lost": lambda session, store, ledger: ledger.marks.update({(new_id(), new_id(), 0): (1.0, 2.0, 1)}),
    "doubled": lambda session, store, ledger: add(session, Vehicle, add(session, Fleet, name="fleet")),
    "different_bits": other_bytes,
    "stuck": lambda session, store, ledger: ledger.never_answered.append("POST /fleets"),
    "orphans": lambda session, store, ledger: add(session, Blob, key="a", state="reserved"),
}


@one_database
@pytest.mark.parametrize("kind", [None, *BROKEN])
def test_a_broken_promise_is_found(database, tmp_path: Path, kind: str | None):
    store, ledger = folder_store(tmp_path / "blobs"), Ledger()
    with database.writing() as session:
        if kind:
            BROKEN[kind](session, store, ledger)
        found = check(session, store, [one.key for one in store.list()], ledger, Expected()).by_kind()
    assert bool(found.pop(kind)) if kind else not any(found.values()), found


@pytest.mark.slow
def test_the_campaign_in_its_short_form_finds_every_promise_kept(tmp_path: Path):
    """A few faults of different kinds; `make faults` is the long form."""
    command = [sys.executable, "-m", "benchmarks.campaign", "--seconds", "10", "--keep-logs", str(tmp_path)]
    command += ["--seed", str(DRAWS.seed)]
    run = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})
    assert run.returncode == 0, run.stderr[-6000:]
    said = json.loads(run.stdout.splitlines()[-1])
    assert {name: said[name] for name in BROKEN} == dict.fromkeys(BROKEN, 0)
    assert said["faults_injected"] >= 3 and len(said["faults"]) >= 3
    assert said["calibrations"] >= 6 and said["uploads"] >= 2 and said["marks"] >= 20
