"""`apexcal serve`: what dies comes back, nothing outlives it, and it says clearly why it does not start."""

import contextlib
import fcntl
import json
import os
import signal
import socket
import sqlite3
import subprocess
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from apexcal.documents.recordings import RecordingView
from apexcal.documents.served_folder import is_served, read_status
from apexcal.embedded.folder import DataFolder, FolderInUseError
from apexcal.rigs import read_rig
from service.platform.storage.store import MARKER
from tests.faults.jobs import ask, new_rig
from tests.support.served import SERVE, start, stop

pytestmark = pytest.mark.faults

# A calibration of a moment.
QUICK = {"slots": 4, "population": 400, "generations": 20, "max_iterations": 4}


def eventually(true: Callable[[], bool], what: str, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, f"{what} did not happen within {seconds} s"
        time.sleep(0.05)


def ready(url: str) -> bool:
    try:
        with urllib.request.urlopen(url + "/readyz", timeout=5) as answer:
            return answer.status == 200
    except (urllib.error.URLError, OSError):
        return False


def session_of(pid: int) -> set[int]:
    """Every living process of the session that `pid` leads, as /proc has it."""
    found = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[3]) == pid and fields[0] != "Z":
                found.add(int(entry.name))
    return found


@pytest.mark.parametrize("name", ["broker", "worker", "worker-ingest", "sweeper", "api"])
def test_a_killed_child_is_back_and_the_service_ready(embedded, name):
    before = embedded.children()[name]
    family = session_of(before["pid"])
    os.kill(before["pid"], signal.SIGKILL)
    eventually(lambda: embedded.children()[name]["restarts"] > before["restarts"], f"a new {name}")
    eventually(lambda: embedded.children()[name]["state"] == "running", f"the new {name}'s start")
    eventually(lambda: ready(embedded.url), "readiness")
    eventually(lambda: not family & session_of(before["pid"]), f"the end of what the old {name} left behind")
    others = {child["pid"] for child in embedded.children().values()}
    assert before["pid"] not in others
    eventually(lambda: len(session_of(embedded.children()["worker"]["pid"])) >= 3, "the worker's pool")


def reader_of(embedded) -> int:
    """The process that reads an upload at this moment; it leads a session of its own."""
    found = []

    def there() -> bool:
        for entry in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                command = (entry / "cmdline").read_bytes()
                if b"workers.readers" in command and os.fsencode(embedded.data) in command:
                    found.append(int(entry.name))
        return bool(found)

    eventually(there, "the reading of an upload")
    return found[0]


def test_a_file_that_takes_long_to_read_keeps_no_other_fleet_waiting(embedded, owner, simulated):
    """Neither its calibration nor its upload; and the fleet's own next file comes when the first is read."""

    def uploaded(name, vehicle, rig) -> RecordingView:
        return owner.recordings.upload(simulated / "recording.bag", vehicle.id, rig.id, name=name)

    def state(recording: RecordingView) -> str:
        return owner.recordings.get(recording.id).state

    assert owner.wait(ask(owner, "Warm", schedule=QUICK)).state == "done"
    described = read_rig(simulated / "rig.json", "Rig")
    slow, patient = (new_rig(owner, described, name) for name in ("Slow", "Patient"))
    first = uploaded("first", *slow)
    reader = reader_of(embedded)
    os.kill(reader, signal.SIGSTOP)
    try:
        second = uploaded("second", *slow)
        # Who waits for the reader is not done before the reader ends: it gets nowhere for a minute first.
        assert owner.wait(ask(owner, "Other", schedule=QUICK)).state == "done"
        assert owner.wait(uploaded("other", *patient)).state == "ready"
        assert (state(first), state(second)) == ("ingesting", "queued")
    finally:
        os.kill(reader, signal.SIGCONT)
    assert [owner.wait(one).state for one in (first, second)] == ["ready", "ready"]


def test_a_second_serve_on_the_same_folder_is_refused(embedded):
    second = subprocess.run([*SERVE, "--data", str(embedded.data)], capture_output=True, text=True)
    assert second.returncode == 1
    assert embedded.url in second.stderr
    assert "--data" in second.stderr
    assert ready(embedded.url)


def test_a_busy_port_is_said(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        refused = subprocess.run(
            [*SERVE, "--data", str(tmp_path / "data"), "--port", str(port)],
            capture_output=True,
            text=True,
        )
    assert refused.returncode == 1
    assert str(port) in refused.stderr
    assert "--port" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not is_served(tmp_path / "data")


def test_a_folder_that_cannot_be_made_is_said(tmp_path):
    (tmp_path / "file").touch()
    for data in (tmp_path / "file", tmp_path / "file" / "below", Path("/proc/apexcal")):
        refused = subprocess.run([*SERVE, "--data", str(data)], capture_output=True, text=True)
        assert refused.returncode == 1
        assert str(data) in refused.stderr
        assert "--data" in refused.stderr
        assert "Traceback" not in refused.stderr


def is_refused_on_another_disk(data: Path) -> None:
    with closing(sqlite3.connect(data / "apexcal.db")) as rows, rows:
        rows.execute(
            "INSERT INTO blob (key, state, size, failed_removals, created_at) VALUES ('a/b', 'stored', 1, 0, 1)"
        )
    (data / "blobs" / MARKER).unlink()
    (data / "blobs" / "lost+found").mkdir()
    refused = subprocess.run([*SERVE, "--data", str(data)], capture_output=True, text=True)
    assert refused.returncode == 1
    assert "disk mounted" in refused.stderr and "--anew" in refused.stderr
    assert not (data / "blobs" / MARKER).exists()


def test_a_killed_parent_leaves_no_child_and_a_stopped_one_neither(tmp_path):
    """Also with a path that is too long for a socket, which then lies elsewhere."""
    data = tmp_path / ("deep" * 20) / "data"
    first = start(data)
    families = {name: session_of(child["pid"]) for name, child in first.children().items()}
    assert set(families) == {"broker", "api", "worker", "worker-ingest", "sweeper"}
    assert all(families.values())
    first.process.kill()
    first.process.wait()
    first.process.stdout.close()
    everyone = set().union(*families.values())
    leaders = [min(family) for family in families.values()]
    eventually(lambda: not any(everyone & session_of(leader) for leader in leaders), "the children's end")
    assert (data / "supervisor.json").exists()
    assert not is_served(data), "what a killed one left says nothing"
    second = start(data)
    leaders = [child["pid"] for child in second.children().values()]
    try:
        assert ready(second.url)
        assert second.said["owner_link"] != first.said["owner_link"]
    finally:
        assert stop(second) == 0
    assert not any(session_of(leader) for leader in leaders)
    assert not is_served(data)
    assert not (data / "supervisor.json").exists()
    is_refused_on_another_disk(data)


def test_the_lock_is_the_holders_and_ends_with_it(tmp_path):
    holder = DataFolder(tmp_path)
    holder.status.write_text(json.dumps({"pid": os.getpid(), "url": "http://of.a.killed.one"}))
    holder.hold()
    assert read_status(tmp_path) == {}, "also where its process id is somebody else's by now"
    holder.status.write_text(json.dumps({"pid": 1, "url": "http://here"}))
    with pytest.raises(FolderInUseError, match="http://here"):
        DataFolder(tmp_path).hold()
    assert is_served(tmp_path)
    holder.release()
    with (tmp_path / "serve.lock").open() as looking:
        fcntl.flock(looking, fcntl.LOCK_SH)
        assert not is_served(tmp_path), "who looks holds nothing"
        threading.Timer(0.03, looking.close).start()
        holder.hold()
    holder.release()
    assert not is_served(tmp_path)


def test_a_log_that_grows_is_cut_while_its_process_runs(embedded):
    log, kept = embedded.data / "logs" / "api.log", embedded.data / "logs" / "api.log.1"
    lines = "".join(f"{number:09d} a stranger's line\n" for number in range(400_000))
    with log.open("ab", buffering=0) as output:
        output.write(lines.encode())
    eventually(lambda: log.stat().st_size < 1_000_000, "the end of a long log")
    assert kept.stat().st_size == 10 * 1024 * 1024
    assert "000399999 a stranger's line" in kept.read_text()
    page = urllib.request.Request(f"{embedded.url}/?a-later-line", headers={"Accept": "text/html"})
    urllib.request.urlopen(page, timeout=5).close()
    eventually(lambda: " GET / 200 " in log.read_text(), "a later line in the same file")
    assert "\0" not in log.read_text()
