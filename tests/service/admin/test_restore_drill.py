"""The restore drill: back up while work runs, lose everything, restore elsewhere, serve, compare byte for byte.

SQLite has a folder beside it and PostgreSQL a bucket, where it is backed up and where it is restored.
"""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from sqlalchemy import func, select, text
from typer.testing import CliRunner, Result

from service.admin import __main__ as commands
from service.admin.backup import back_up
from service.admin.context import AdminError
from service.admin.manifest import BLOB_LIST, BLOBS, ROWS, verify
from service.admin.restore import restore
from service.app import create_app
from service.platform.db.grants import OF_API
from service.platform.db.migrate import make_roles, upgrade
from service.platform.db.models import Base, Blob, Job
from service.platform.db.session import Database
from service.platform.jobs.reaper import reap
from service.platform.settings import Settings, get_settings
from service.platform.storage.errors import StoreUnavailableError
from service.platform.storage.store import Store, open_store
from tests.contract.test_work import SCHEDULE, pairs_of_a_pinhole
from tests.support import walks
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.people import Actor, Api, TestClient
from tests.support.postgres import ROLES, Postgres, as_role
from tests.support.s3 import S3Server
from tests.support.uploads import put_part
from tests.support.work import work
from workers.tasks.context import Context


@pytest.fixture
def walk() -> Path:
    """A short simulated recording and its rig."""
    return walks.walk("moment")


class Site:
    """A service with work in it, and what it answers about that work."""

    def __init__(self, api: Api, store: Store, walk: Path) -> None:
        self.api = api
        self.store = store
        self.fleet = api.fleet()
        self.engineer = api.member(self.fleet, "engineer")
        vehicle = self.engineer.post(f"/fleets/{self.fleet}/vehicles", {"name": "van"}).json()["id"]
        rig = json.loads((walk / "rig.json").read_text())
        rig = self.engineer.post(f"/vehicles/{vehicle}/rigs", {**rig, "name": "roof"})
        assert rig.status_code == 201, rig.text
        self.vehicle, self.rig = vehicle, rig.json()["id"]
        self.camera = rig.json()["cameras"][0]["name"]

    def upload(self, file: Path, *, complete: bool = True) -> str:
        """Upload a recording in two parts; without the last word it stays on its way."""
        body = {"rig_id": self.rig, "name": file.name, "file_name": file.name}
        made = self.engineer.post(f"/vehicles/{self.vehicle}/recordings", body).json()["id"]
        data = file.read_bytes()
        half = len(data) // 2
        for number, part in enumerate((data[:half], data[half:]), 1):
            assert put_part(self.engineer, made, number, part).status_code == 200
        if complete:
            done = {"parts": 2, "size": len(data), "sha256": None}
            assert self.engineer.post(f"/recordings/{made}/complete", done).status_code == 202
        return made

    def calibrate(self) -> str:
        """Ask for a calibration of imported pairs."""
        made = bring_pairs(self.engineer, self.rig, pairs_of_a_pinhole(), self.camera)
        quick = {"models": ["pinhole"], "folds": 2, "schedule": SCHEDULE}
        return ask_calibration(self.engineer, self.vehicle, made, **quick)

    def publish(self, calibration: str) -> None:
        """Give the vehicle what the finished calibration found."""
        done = self.engineer.get(f"/calibrations/{calibration}").json()
        found = done["summary"]["cameras"][self.camera]["models"]["pinhole"]
        override = {"override": {"reason": "The pairs are another camera's."}}
        answer = self.engineer.post(f"/results/{found['result_id']}/publication", override)
        assert answer.status_code == 201, answer.text

    def answers(self, engineer: Actor, recording: str) -> dict[str, bytes]:
        """What a client reads: the published calibration, the marks, frames, the recording."""
        addresses = [
            f"/vehicles/{self.vehicle}/cameras/{self.camera}/calibration",
            f"/recordings/{recording}/cameras/{self.camera}/frames/0/mark",
            *(f"/recordings/{recording}/cameras/{self.camera}/frames/{index}" for index in (0, 3)),
            f"/recordings/{recording}",
            f"/recordings/{recording}/cameras/{self.camera}/frames",
        ]
        found: dict[str, bytes] = {}
        for address in addresses:
            answer = engineer.get(address)
            assert answer.status_code == 200, f"{address}: {answer.text}"
            found[address] = answer.content
        return found


@pytest.fixture
def site(api: Api, walk: Path) -> Site:
    return Site(api, api.app.state.store, walk)


@pytest.fixture
def settings(settings: Settings, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """The process's settings, with a fresh bucket beside PostgreSQL."""
    if settings.database.startswith("sqlite"):
        return settings
    server: S3Server = request.getfixturevalue("s3_server")
    for name, value in server.environment(server.make_bucket()).items():
        monkeypatch.setenv(name, value)
    get_settings.cache_clear()
    return get_settings()


@pytest.fixture
def elsewhere(tmp_path: Path, postgres: Postgres, s3_server: S3Server) -> Iterator[Callable[[str], Settings]]:
    """Settings of a new, empty place of each kind."""

    def make(kind: str) -> Settings:
        folder = tmp_path / f"elsewhere-{kind}-{uuid4().hex[:6]}"
        folder.mkdir()
        blobs: dict[str, Any] = {"blob_url": ""}
        url = f"sqlite:///{folder / 'apexcal.db'}"
        if kind == "postgresql":
            blobs = s3_server.settings(s3_server.make_bucket())
            url = postgres.create(f"drill_{uuid4().hex}")
        fixed = {"broker_url": "redis+socket:///nowhere", "min_free_bytes": 0}
        return Settings(data_dir=folder, database_url=url, **fixed, **blobs)

    yield make


def test_what_was_published_marked_and_recorded_is_served_again_with_the_same_bytes(
    site: Site, walk: Path, settings: Settings, tmp_path: Path, elsewhere: Callable[[str], Settings]
) -> None:
    context = Context(settings)
    bag = next(walk.glob("*.bag"))
    recording, doomed, on_its_way = site.upload(bag), site.upload(bag), site.upload(bag, complete=False)
    calibration = site.calibrate()
    work(context)
    site.publish(calibration)
    mark = f"/recordings/{recording}/cameras/{site.camera}/frames/0/mark"
    marked = site.engineer.put(mark, json={"u": 100.25, "v": 50.75}, headers={"If-None-Match": "*"})
    assert marked.status_code == 200, marked.text
    before = site.answers(site.engineer, recording)
    frame = site.engineer.get(f"/recordings/{doomed}/cameras/{site.camera}/frames/0").content

    disturbed: list[str] = []

    def while_it_runs(line: str) -> None:
        """After the snapshot: a recording is deleted and swept, another arrives, a calibration is asked for."""
        if not disturbed:
            disturbed.append(line)
            assert site.engineer.delete(f"/recordings/{doomed}").status_code == 204
            reap(context.database, context.store)
            site.calibrate()
            work(context)
            site.upload(bag)

    manifest = back_up(context.database, context.store, tmp_path / "backup", report=while_it_runs)
    assert disturbed and manifest.blobs > 6
    reap(context.database, context.store)
    with context.database.reading() as session:
        assert session.scalar(select(func.count()).where(Blob.state == "condemned")) == 0, "the hold has ended"
    _wreck(context)
    context.database.close()

    # A backup is the same files whatever made it: that of SQLite is written to both.
    for kind in ("postgresql", "sqlite") if settings.database.startswith("sqlite") else ("sqlite",):
        there = elsewhere(kind)
        restore(there.database, open_store(there), tmp_path / "backup")
        if kind == "postgresql":
            make_roles(there.database, ROLES)
        app = create_app(there)
        with TestClient(app, base_url="http://127.0.0.1:8000") as client:
            engineer = Actor(site.engineer.person_id, site.engineer.token, client)
            assert site.answers(engineer, recording) == before
            # Deleted after the snapshot, so it is there, and whole; what was asked for later is not.
            assert engineer.get(f"/recordings/{doomed}/cameras/{site.camera}/frames/0").content == frame
            assert len(engineer.get(f"/vehicles/{site.vehicle}/calibrations").json()["items"]) == 1
            _goes_on(Api(app, client), there, engineer, on_its_way, bag)


def _goes_on(api: Api, there: Settings, engineer: Actor, on_its_way: str, bag: Path) -> None:
    """An upload that was on its way is completed, and new rows get numbers that are not taken."""
    done = {"parts": 2, "size": bag.stat().st_size, "sha256": None}
    assert engineer.post(f"/recordings/{on_its_way}/complete", done).status_code == 202
    context = Context(there)
    work(context)
    context.database.close()
    assert engineer.get(f"/recordings/{on_its_way}").json()["state"] == "ready"
    reap(api.database, open_store(there))
    with api.database.reading() as session:
        states = set(session.scalars(select(Job.state)))
    assert states == {"done"}


def _wreck(context: Context) -> None:
    with context.database.writing() as session:
        for table in reversed(Base.metadata.sorted_tables):
            session.execute(table.delete())
    for found in list(context.store.list()):
        context.store.delete(found.key)


def _small_backup(settings: Settings, target: Path) -> tuple[Database, Store, str]:
    database, store = Database(settings.database), open_store(settings)
    key = "recordings/x/parts/y"
    store.put_bytes(key, b"frames")
    with database.writing() as session:
        session.add(Blob(key=key, state="stored", size=6, sha256=hashlib.sha256(b"frames").hexdigest()))
    back_up(database, store, target)
    return database, store, key


def test_what_the_store_lost_or_changed_is_named_and_all_else_is_backed_up(
    settings: Settings, tmp_path: Path, elsewhere: Callable[[str], Settings]
) -> None:
    database, store, whole = _small_backup(settings, tmp_path / "one")
    with pytest.raises(AdminError, match="exists already"):
        back_up(database, store, tmp_path / "one")
    (tmp_path / "two.partial").mkdir()  # somebody's own
    found = {"changed": b"FRAMES", "cut": b"fra", "lost": None, "unchecked": b"FRAMES"}
    for name, data in found.items():
        with database.writing() as session:
            checksum = None if name == "unchecked" else hashlib.sha256(b"frames").hexdigest()
            session.add(Blob(key=f"recordings/{name}", state="stored", size=6, sha256=checksum))
        if data:
            store.put_bytes(f"recordings/{name}", data)

    def typed(*words: str) -> Result:
        return CliRunner().invoke(commands.app, list(words), prog_name="apexcal admin")

    made = typed("backup", "--quiet", str(tmp_path / "two"))
    checked = typed("restore", "--check", str(tmp_path / "two"))
    for said in (made, checked):
        assert said.exit_code == 1, said.output
        assert said.stderr.splitlines()[:4] == [
            "recordings/changed: not the bytes that were stored: the SHA-256 differs",
            "recordings/cut: 3 bytes instead of 6",
            "recordings/lost: missing",
            "apexcal admin: the store had lost, changed or could not read 3 objects when this was backed up.",
        ]
    assert "All else is backed up" in made.stderr and "holds what could be backed up" in checked.stdout
    assert "is whole" in typed("restore", "--check", str(tmp_path / "one")).stdout
    quiet = typed("restore", "--check", "--quiet", str(tmp_path / "two"))
    assert (quiet.exit_code, quiet.stdout) == (1, "") and "recordings/lost: missing" in quiet.stderr
    there = elsewhere("sqlite")
    restore(there.database, open_store(there), tmp_path / "two")
    brought = {one.key: b"".join(open_store(there).stream(one.key)) for one in open_store(there).list()}
    kept = {f"recordings/{name}": data for name, data in found.items() if data}
    assert brought == {whole: b"frames", **kept}, "no less than there was"
    database.close()
    assert [one.name for one in tmp_path.glob("*partial*")] == ["two.partial"], "nothing half done"


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_what_cannot_be_read_is_tried_again_then_named(settings: Settings, tmp_path: Path, monkeypatch) -> None:
    database, store, _ = _small_backup(settings, tmp_path / "one")
    assert store.folder
    keys = [f"recordings/{number:02}" for number in range(20)]
    files = [store.folder / key for key in keys]
    with database.writing() as session:
        session.add_all(Blob(key=key, state="stored", size=1) for key in keys)
    for file in files:
        file.symlink_to(file)  # reading it fails: too many levels of links
    guard, whole = threading.Lock(), tmp_path / "whole"

    def pause(seconds: float) -> None:
        """All but one can be read after the first failure."""
        with guard:
            for file in files[1:]:
                whole.write_bytes(b"x")
                whole.replace(file)

    monkeypatch.setattr("service.admin.objects.time.sleep", pause)
    found = back_up(database, store, tmp_path / "two")
    assert [(one.key, one.what) for one in found.damaged] == [(keys[0], "not readable: the store fails on it")]
    assert found.blobs == len(verify(tmp_path / "two")[1]) == 20
    for file in files:
        file.unlink()
        file.symlink_to(file)
    monkeypatch.setattr("service.admin.objects.time.sleep", lambda seconds: None)
    with pytest.raises(StoreUnavailableError):  # so many in a row are no bad sectors
        back_up(database, store, tmp_path / "three")
    database.close()
    assert not (tmp_path / "three").exists()


def test_a_damaged_backup_restores_nothing(
    settings: Settings, tmp_path: Path, elsewhere: Callable[[str], Settings]
) -> None:
    folder = tmp_path / "backup"
    database, _, key = _small_backup(settings, folder)
    database.close()
    there = elsewhere("sqlite")
    for damaged in (folder / BLOBS / key, folder / ROWS, folder / BLOB_LIST):
        whole = damaged.read_bytes()
        damaged.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
        with pytest.raises(AdminError, match="SHA-256 differs"):
            restore(there.database, open_store(there), folder)
        damaged.write_bytes(whole)
    verify(folder)
    listed = (folder / "manifest.json").read_text()
    (folder / "manifest.json").write_text(listed.replace('"schema_revision": "', '"schema_revision": "9'))
    with pytest.raises(AdminError, match="newer than this version"):
        restore(there.database, open_store(there), folder)
    (folder / "manifest.json").unlink()
    with pytest.raises(AdminError, match="no finished backup"):
        restore(there.database, open_store(there), folder)
    assert not Path(there.database.removeprefix("sqlite:///")).exists()
    assert list(open_store(there).list_unprepared()) == []


def test_a_restore_never_mixes_two_histories(
    settings: Settings, tmp_path: Path, elsewhere: Callable[[str], Settings]
) -> None:
    folder = tmp_path / "backup"
    database, store, _ = _small_backup(settings, folder)
    with pytest.raises(AdminError, match="the database is not empty: blob has rows"):
        restore(settings.database, store, folder)
    database.close()
    there = elsewhere("sqlite")
    open_store(there).prepare()
    open_store(there).put_bytes("recordings/other", b"somebody else's")
    with pytest.raises(AdminError, match="the store is not empty: it holds 'recordings/other'"):
        restore(there.database, open_store(there), folder)
    open_store(there).delete("recordings/other")
    # A schema that is there and empty is what a fleet's migrations leave before its first start.
    upgrade(there.database)
    restore(there.database, open_store(there), folder)
    opened = Database(there.database)
    with opened.reading() as session:
        assert session.scalars(select(Blob.key)).all() == ["recordings/x/parts/y"]
    opened.close()


def test_the_apis_role_backs_up_and_the_owner_of_the_tables_restores(
    settings: Settings, tmp_path: Path, postgres: Postgres, elsewhere: Callable[[str], Settings]
) -> None:
    """Roles as docker-compose.yml gives them. Who may not restore copies nothing before it says so."""
    if settings.database.startswith("sqlite"):
        pytest.skip("SQLite has no roles")
    folder = tmp_path / "backup"
    settings = settings.model_copy(update={"database_url": as_role(settings.database, OF_API)})
    _small_backup(settings, folder)[0].close()
    there = elsewhere("sqlite")
    url = postgres.migrated(f"drill_{uuid4().hex}")
    with pytest.raises(AdminError, match=f"the database's role {OF_API} may not write") as refused:
        restore(as_role(url, OF_API), open_store(there), folder)
    assert "the role that migrations have" in refused.value.hint
    assert list(open_store(there).list_unprepared()) == []
    restore(url, open_store(there), folder)
    api = Database(as_role(url, OF_API))
    with api.writing() as session:
        assert session.scalars(select(Blob.key)).all() == ["recordings/x/parts/y"]
        number = session.scalar(text("SELECT nextval('job_id_seq')"))
    api.close()
    assert number == 1
