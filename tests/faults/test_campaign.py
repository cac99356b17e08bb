"""The campaign in its short form, and its checks against defects that were planted."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path
from random import Random

import pytest
from sqlalchemy import delete, update

from service.platform.db.models import (
    Answer,
    Blob,
    Calibration,
    CalibrationRun,
    Detection,
    Job,
    Recording,
    Result,
    Sensor,
    Slot,
    UploadPart,
    Vehicle,
)
from service.platform.db.session import Database
from tests.faults.campaign.kinds import KINDS
from tests.faults.campaign.schedule import draw
from tests.faults.campaign_world import World, make_world
from tests.support.folders import folder_store

pytestmark = pytest.mark.faults


@pytest.fixture
def world(tmp_path: Path, sqlite_template: Path) -> Iterator[World]:
    shutil.copy(sqlite_template, tmp_path / "apexcal.db")
    database = Database(f"sqlite:///{tmp_path / 'apexcal.db'}")
    with database.writing() as session:
        yield make_world(session, folder_store(tmp_path / "blobs"))
    database.close()


def test_nothing_is_found_where_every_promise_was_kept(world: World):
    assert not any(world.findings().by_kind().values()), world.findings()


def _again(world: World, table: type[Vehicle] | type[Job]) -> None:
    """A row made a second time, as by a request whose repetition was not recognised."""
    row = world.session.query(table).first()
    assert row is not None
    values = {column.name: getattr(row, column.name) for column in table.__table__.columns if column.name != "id"}
    world.session.add(table(**values | ({"name": "another"} if table is Vehicle else {})))


def _set(world: World, table: type, **values: object) -> None:
    world.session.execute(update(table).values(**values))


DEFECTS: dict[str, tuple[str, Callable[[World], object]]] = {
    "an object is gone": ("lost", lambda w: w.store.delete(w.part_key)),
    "a part is gone": ("lost", lambda w: w.session.execute(delete(UploadPart))),
    "a mark is gone": ("lost", lambda w: w.session.execute(delete(Answer))),
    "a mark went back": ("lost", lambda w: _set(w, Answer, u=11.0)),
    "a calibration is gone": ("lost", lambda w: w.session.execute(delete(Calibration))),
    "a result is gone": ("lost", lambda w: w.session.execute(delete(Result))),
    "a slot is gone": ("lost", lambda w: w.session.execute(delete(Slot).where(Slot.slot == 1, Slot.iteration == 0))),
    "a request failed": ("lost", lambda w: _set(w, Calibration, state="failed")),
    "an upload failed": ("lost", lambda w: _set(w, Recording, state="failed")),
    "a used object is condemned": ("lost", lambda w: _set(w, Blob, state="condemned")),
    "a vehicle was made twice": ("doubled", lambda w: _again(w, Vehicle)),
    "a job was made twice": ("doubled", lambda w: _again(w, Job)),
    "a slot nobody asked for": ("doubled", lambda w: _set(w, CalibrationRun, iteration=1)),
    "a revision too many": ("doubled", lambda w: _set(w, Answer, version=2)),
    "runs counted twice": ("doubled", lambda w: _set(w, Calibration, remaining=-1)),
    "bundles counted twice": ("doubled", lambda w: _set(w, CalibrationRun, remaining=-1)),
    "shards counted twice": ("doubled", lambda w: _set(w, Detection, remaining=-1)),
    "another result": ("different_bits", lambda w: _set(w, Result, document={"rms_px": 1.0 + 2e-16})),
    "other bytes": ("different_bits", lambda w: w.store.put_bytes(w.part_key, b"bytez")),
    "other sensors": ("different_bits", lambda w: _set(w, Sensor, count=2)),
    "other vertices": ("different_bits", lambda w: _set(w, Detection, counts={"vertices": 1})),
    "a job waits for ever": ("stuck", lambda w: _set(w, Job, state="queued")),
    "a job's worker is gone": ("stuck", lambda w: _set(w, Job, state="running")),
    "a request waits for ever": ("stuck", lambda w: _set(w, Calibration, state="running")),
    "a run waits for ever": ("stuck", lambda w: _set(w, CalibrationRun, state="running", remaining=1)),
    "an upload waits for ever": ("stuck", lambda w: _set(w, Recording, state="ingesting")),
    "a client waits for ever": ("stuck", lambda w: w.ledger.never_answered.append("POST /fleets")),
    "an object without a row": ("orphans", lambda w: w.store.put_bytes("recordings/gone/parts/1", b"bytes")),
    "a reservation is left": ("orphans", lambda w: w.session.add(Blob(key="a", state="reserved"))),
    "a row that nothing uses": ("orphans", lambda w: w.session.add(Blob(key="b", state="stored"))),
}


@pytest.mark.parametrize(("kind", "plant"), DEFECTS.values(), ids=DEFECTS)
def test_a_planted_defect_is_found(world: World, kind: str, plant: Callable[[World], object]):
    plant(world)
    assert world.findings().by_kind()[kind]


def test_a_seed_gives_the_same_schedule_again_and_every_kind_has_its_turn():
    once, again = (draw(Random(7), 600.0, 2.5, list(KINDS)) for _ in range(2))
    assert once == again
    assert {fault.kind for fault in once} == set(KINDS)
    assert draw(Random(8), 600.0, 2.5, list(KINDS)) != once


def test_a_clock_that_is_wrong_is_wrong_everywhere():
    said = "import time, datetime; print(time.time(), time.time_ns(), datetime.datetime.now().timestamp())"
    shifted = "from tests.faults.campaign.shifted import shift; shift(300); " + said
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True) for code in (said, shifted)]
    clocks = [[float(word) for word in run.stdout.split()] for run in runs]
    behind, ahead = clocks[0][0], clocks[1]
    assert [timedelta(seconds=ahead[0] - behind), timedelta(seconds=ahead[2] - behind)] == [
        pytest.approx(timedelta(seconds=300), abs=timedelta(seconds=30))
    ] * 2
    assert ahead[1] / 1e9 - behind == pytest.approx(300, abs=30)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_campaign_in_its_short_form_finds_every_promise_kept(tmp_path: Path):
    """A few faults of different kinds; `make faults` is the long form."""
    command = [sys.executable, "-m", "tests.faults.campaign", "--seconds", "10", "--keep-logs", str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})
    assert run.returncode == 0, run.stderr[-6000:]
    said = json.loads(run.stdout.splitlines()[-1])
    assert {name: said[name] for name in ("lost", "doubled", "different_bits", "stuck", "orphans")} == {
        "lost": 0,
        "doubled": 0,
        "different_bits": 0,
        "stuck": 0,
        "orphans": 0,
    }
    assert said["faults_injected"] >= 3 and len(said["faults"]) >= 3
    assert said["calibrations"] >= 6 and said["uploads"] >= 2 and said["marks"] >= 20
