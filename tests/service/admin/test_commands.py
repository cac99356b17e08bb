"""`apexcal admin`, as an operator types it: help, outcomes, clear refusals, exit codes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select, update
from typer.testing import CliRunner, Result

from service.admin import __main__ as commands
from service.admin.context import GIVEN_FOLDER, command
from service.platform.db.clock import now, utc_now
from service.platform.db.models import (
    ApiToken,
    Blob,
    BrowserSession,
    Calibration,
    CalibrationRun,
    Detection,
    Job,
    Recording,
    Sensor,
    Slot,
)
from service.platform.db.session import Database
from service.platform.jobs.claims import claim, finishing
from service.platform.jobs.history import tally
from service.platform.jobs.queue import enqueue, enqueue_all
from service.platform.settings import get_settings
from tests.faults.jobs import pairs
from tests.service.detections.seeding import seed_recording, seed_rig
from tests.service.platform.jobs.support import make_calibration, make_fleet, make_jobs
from tests.support.asking import bring_pairs
from tests.support.people import Api
from tests.support.uploads import new_vehicle

FAILED = {"code": "worker_lost", "detail": "", "hint": ""}


@pytest.fixture
def run(settings) -> Any:
    """Type a command; standard output and errors apart."""

    def typed(*words: str) -> Result:
        return CliRunner().invoke(commands.app, list(words), prog_name="apexcal admin")

    return typed


def said(result: Result) -> Any:
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def refused(result: Result, *words: str) -> None:
    assert result.exit_code == 1, result.output
    for word in words:
        assert word in result.stderr, result.stderr
    assert "Traceback" not in result.stderr


def fail(database: Database, job_id: int) -> None:
    held = claim(database, job_id, "w")
    assert held
    with finishing(database, held, "failed", FAILED):
        pass


def test_the_command_hands_everything_on(tmp_path) -> None:
    def typed(*words: str) -> subprocess.CompletedProcess[str]:
        environment = {name: value for name, value in os.environ.items() if not name.startswith("APEXCAL_")}
        command = [sys.executable, "-m", "apexcal.cli", "admin", *words]
        return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path)

    helped = typed("backup", "--help")
    assert helped.returncode == 0 and "apexcal admin backup" in helped.stdout, helped.stderr
    absent = typed("--data", str(tmp_path / "none"), "users", "list")
    assert absent.returncode == 1 and "there is no service here" in absent.stderr and "--data" in absent.stderr


def test_every_command_says_what_it_is_for(run) -> None:
    names = ("jobs", "job", "requeue", "backup", "restore", "users link", "tokens revoke", "retention set")
    for name in names:
        helped = run(*name.split(), "--help")
        assert helped.exit_code == 0 and len(helped.stdout.splitlines()) > 4, name
    usages = ("bogus", "job many", f"job {2**63}", f"requeue {2**63}", "job 0", "requeue 0", "jobs --state lost")
    for wrong in (*usages, "tokens revoke ada", "retention set north --days 3", "retention set north --days -1"):
        ended = run(*wrong.split())
        assert ended.exit_code == 2 and ended.stderr and "Traceback" not in ended.output, wrong


def test_people_and_tokens(run, api: Api) -> None:
    fleet = api.fleet("north")
    ada = api.member(fleet, "engineer", "Ada")
    for _ in range(2):
        api.member(fleet, "viewer", "Bo")
    with api.database.writing() as session:
        ends = utc_now() + timedelta(days=1)
        session.add(BrowserSession(secret_hash="0" * 64, person_id=ada.person_id, expires_at=ends))
    assert {"id": str(ada.person_id), "name": "Ada", "roles": ["engineer of north"]} in said(
        run("users", "list", "--json")
    )
    refused(run("users", "link", "Bo"), "2 people are called 'Bo'", "users list")
    refused(run("users", "link", "Nobody"), "nobody called 'Nobody'")
    link = run("users", "link", "Ada").stdout.split()[-1]
    assert api.client.post("/v1/sign-in", json={"link": link}, headers={"Origin": "http://127.0.0.1:8000"}).is_success
    api.client.cookies.clear()
    (token,) = [one for one in said(run("tokens", "list", "--json")) if one["person"] == "Ada"]
    assert ada.get("/fleets").status_code == 200
    assert run("tokens", "revoke", token["id"]).exit_code == 0
    assert ada.get("/fleets").status_code == 401
    refused(run("tokens", "revoke", token["id"]), "no valid token")
    ended = run("users", "revoke", str(ada.person_id))
    assert "2 sessions, 0 links and 0 tokens" in ended.stdout
    with api.database.reading() as session:
        assert session.scalars(select(BrowserSession)).all() == []
        assert session.scalar(select(ApiToken.revoked_at).where(ApiToken.person_id == ada.person_id))


def test_the_audit_says_who_took_gave_and_deleted_what(run, api: Api) -> None:
    """What was refused is not in it."""
    fleet = api.fleet("north")
    ada, bo = api.member(fleet, "admin", "Ada"), api.member(fleet, "viewer", "Bo")
    made = new_vehicle(ada, fleet)
    pair_set = bring_pairs(ada, made["rig"], pairs(5, 1))
    assert bo.get(f"/correspondence-sets/{pair_set}", headers={"X-Request-ID": "taken"}).is_success
    assert bo.delete(f"/rigs/{made['rig']}").status_code == 403
    assert ada.patch(f"/fleets/{fleet}/members/{bo.person_id}", {"role": "engineer"}).is_success
    assert ada.delete(f"/rigs/{made['rig']}").status_code == 204
    entries = said(run("audit", "--json"))
    assert [(entry["person"], entry["what"].split("/")[0:3:2]) for entry in entries] == [
        ("Bo", ["GET ", "correspondence-sets"]), ("Ada", ["PATCH ", "fleets"]), ("Ada", ["DELETE ", "rigs"]),
    ]  # fmt: skip
    assert entries[0]["request"] == "taken" and entries[0]["address"] and entries[0]["token"]
    assert [entry["person"] for entry in said(run("audit", made["rig"], "--person", "Ada", "--json"))] == ["Ada"]
    assert "Bo" in run("audit").stdout


def test_a_forecast_tells_a_year_with_retention_and_without(run, database: Database) -> None:
    rig = seed_rig(database, make_fleet(database, "north"))
    seed_recording(database, rig, 10)
    with database.writing() as session:
        session.execute(update(Recording).values(size=3_000_000))
        camera = session.scalars(select(Sensor).where(Sensor.kind == "lidar")).first()
        assert camera
        session.execute(update(Blob).where(Blob.key == camera.blob_key).values(size=6_000_000))
    assert run("retention", "layers", "north", "--original", "30", "--images", "10").exit_code == 2
    assert "original after 30 days" in run("retention", "layers", "north", "--original", "30").stdout

    def north(*words: str) -> dict[str, Any]:
        return next(line for line in said(run("forecast", *words, "--json")) if line["fleet"] == "north")

    month = north()
    assert month["bytes_a_year"] == round(365 * 9_000_000 / 30)
    assert month["with_retention"] == (30 * 100_000 + 365 * 200_000)
    assert month["rows_a_year"] > 0 and north("--days", "60")["bytes_a_year"] == round(365 * 9_000_000 / 60)
    assert "36 MB" not in run("forecast").stdout and "110 MB" in run("forecast").stdout
    refused(run("retention", "layers", "south", "--original", "3"), "no fleet called 'south'")


def test_a_jobs_history_is_shown(run, database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    _, (run_id,) = make_calibration(database)
    failed, running, waits = make_jobs(database, make_fleet(database, "other"), 3, run_id)
    fail(database, failed)
    assert claim(database, running, "host:7")
    shown = said(run("job", str(failed), "--json"))
    assert [(event["what"], event["worker"], event["reason"]) for event in shown["history"]] == [
        ("failed", "w", "worker_lost")
    ]
    assert said(run("job", str(running), "--json"))["history"][-1]["what"] == "running"
    assert "host:7" in run("job", str(running)).stdout
    for_people = run("job", str(failed)).stdout.split("\n\n")[0]
    assert "problem     worker_lost\n" in for_people + "\n" and "None" not in for_people and "{}" not in for_people
    refused(run("requeue", str(waits)), f"admin job {waits}` shows how it is")
    monkeypatch.setenv(GIVEN_FOLDER, "a b")
    assert command("jobs").endswith("admin --data 'a b' jobs`")
    assert [row["id"] for row in said(run("jobs", "--json"))] == [waits, running, failed]
    assert [row["id"] for row in said(run("jobs", "--state", "failed", "--json"))] == [failed]
    refused(run("job", "4711"), "there is no job 4711")


def test_a_refused_restore_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("APEXCAL_DATABASE_URL", "APEXCAL_BLOB_URL"):
        monkeypatch.setenv(name, "")
    (tmp_path / "theirs").mkdir()
    for there in ("theirs", "new/folder"):
        monkeypatch.setenv("APEXCAL_DATA_DIR", str(tmp_path / there))
        get_settings.cache_clear()
        refused(CliRunner().invoke(commands.app, ["restore", str(tmp_path)]), "no finished backup")
    get_settings.cache_clear()
    assert [str(one.relative_to(tmp_path)) for one in tmp_path.rglob("*") if "blobs" in one.name] == []
    assert (tmp_path / "theirs").exists() and not (tmp_path / "new").exists()


def test_a_failed_run_is_started_again_from_its_beginning(run, database: Database) -> None:
    calibration_id, (run_id, other_id) = make_calibration(database, models=("pinhole", "brown_conrady"))
    with database.writing() as session:
        session.add(
            Slot(run_id=run_id, iteration=0, slot=0, loss=1, parameters=[], evaluations=1, seconds=1, worker="w")
        )
    fleet_id = make_fleet(database, "other")
    first, second = make_jobs(database, fleet_id, 2, run_id)
    refused(run("requeue", str(first)), "is queued; only failed ones")
    fail(database, first)
    refused(run("requeue", str(first)), "other jobs of the same work are under way")
    fail(database, second)
    with database.writing() as session:
        conclusion = enqueue(session, kind="conclude", fleet_id=fleet_id, subject_id=calibration_id).id
    refused(run("requeue", str(first)), "is being concluded")
    with database.writing() as session:
        session.execute(update(Job).where(Job.id == conclusion).values(state="done"))
    began = run("requeue", str(first))
    assert began.exit_code == 0, began.output
    with database.reading() as session:
        again = session.get_one(CalibrationRun, run_id)
        assert (again.state, again.problem, again.remaining, again.iteration) == ("queued", None, 2, 0)
        calibration = session.get_one(Calibration, calibration_id)
        assert (calibration.state, calibration.remaining) == ("running", 2)
        assert session.scalars(select(Slot)).all() == []
        fresh = session.scalars(select(Job.payload).where(Job.subject_id == run_id, Job.state == "queued")).all()
    assert sorted((payload["first"], payload["stop"]) for payload in fresh) == [(0, 1), (1, 2)]
    assert said(run("job", str(first), "--json"))["history"][-1]["what"] == "requeued"
    refused(run("requeue", str(second)), "under way")
    assert other_id


def test_failed_recordings_and_detections_are_started_again(run, database: Database) -> None:
    fleet_id = make_fleet(database)
    recording_id, _ = seed_recording(database, seed_rig(database, fleet_id), 2)
    with database.writing() as session:
        asked = {"region": {}, "detector": "tolerant", "options": {}, "pairing": {}, "content_hash": "0"}
        lidar = session.query(Sensor).filter_by(recording_id=recording_id, kind="lidar").one()
        keys = {"fleet_id": fleet_id, "recording_id": recording_id, "lidar_id": lidar.id}
        row = Detection(**keys, remaining=2, **asked)
        session.add(row)
        session.flush()
        shards = [{"first": 0, "stop": 1}, {"first": 1, "stop": 2}]
        jobs = enqueue_all(session, kind="detect", fleet_id=fleet_id, subject_id=row.id, payloads=shards)
        ids, detection_id = [job.id for job in jobs], row.id
        ingests = enqueue_all(session, kind="ingest", fleet_id=fleet_id, subject_id=recording_id, payloads=[{}])
        ingest_id = ingests[0].id
    for job_id in (*ids, ingest_id):
        fail(database, job_id)
    for job_id in (ids[0], ingest_id):
        assert run("requeue", str(job_id)).exit_code == 0
    with database.reading() as session:
        detection = session.get_one(Detection, detection_id)
        assert (detection.state, detection.remaining, detection.problem) == ("queued", 2, None)
        asked_again = (
            select(Job.payload).where(Job.subject_id == detection_id, Job.state == "queued").order_by(Job.id)
        )
        assert session.scalars(asked_again).all() == shards
        recording = session.get_one(Recording, recording_id)
        assert recording.state == "queued" and recording.job_id not in (None, ingest_id)


def test_a_fleets_quota_is_shown_and_set(run, database: Database) -> None:
    rig = seed_rig(database, make_fleet(database, "north"))
    with database.writing() as session:
        common = {"fleet_id": rig.fleet_id, "vehicle_id": rig.vehicle_id, "rig_id": rig.id, "file_name": "f"}
        session.add(Recording(**common, name="n", taken_bytes=1_500_000))

    def shown() -> tuple[int, int, bool]:
        (row,) = said(run("quota", "show", "--json"))
        return row["taken_bytes"], row["quota_bytes"], row["own"]

    assert shown() == (1_500_000, 200 * 10**9, False)
    assert (
        run("quota", "set", "north", "1.5TB").stdout == "The recordings of north may take 1.5 TB; they take 1.5 MB.\n"
    )
    assert shown() == (1_500_000, 1_500_000_000_000, True)
    for size, count in (("2GiB", 2 * 1024**3), ("700", 700), ("0", 0)):
        assert run("quota", "set", "north", size).exit_code == 0 and shown()[1] == count
    assert run("quota", "set", "north", "default").exit_code == 0 and shown()[1:] == (200 * 10**9, False)
    assert "north" in run("quota", "show").stdout and "200 GB" in run("quota", "show").stdout
    refused(run("quota", "set", "south", "1GB"), "no fleet called 'south'", "quota show")
    for wrong in ("much", "-1", "1XB", "1e9", "9999999999TB"):
        assert run("quota", "set", "north", "--", wrong).exit_code == 2, wrong


def test_retention_is_shown_set_and_carried_out(run, database: Database) -> None:
    fleet_id = make_fleet(database, "north")
    rig = seed_rig(database, fleet_id)
    recording_id, _ = seed_recording(database, rig, 1)
    _, (run_id,) = make_calibration(database)
    (old,) = make_jobs(database, fleet_id, 1, run_id)
    fail(database, old)
    with database.writing() as session:
        session.execute(update(Job).values(finished_at=now(-400 * 86400)))
        tally(session)
    assert run("retention", "set", str(recording_id), "--days", "3").stdout.startswith(
        "1 recordings are deleted after"
    )
    shown = said(run("retention", "show", "--json"))
    assert shown["jobs"]["overdue"] == 1
    assert [(row["fleet"], row["with_end"], row["overdue"]) for row in shown["fleets"] if row["recordings"]] == [
        ("north", 1, 0)
    ]
    refused(run("retention", "set", "nowhere", "--fleet", "--days", "1"), "no recording in a fleet called 'nowhere'")
    with database.writing() as session:
        session.execute(update(Recording).values(retain_until=utc_now() - timedelta(seconds=1)))
    ended = run("retention", "run").stdout
    assert ended.startswith("1 recordings, 0 sets of imported pairs and 1 jobs deleted, 0 unfinished uploads ended")
    with database.reading() as session:
        assert session.get(Recording, recording_id) is None and session.get(Job, old) is None
