import os
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from making_recordings import IMAGE, START_NS, clouds, images, interleaved, raw_image, write_bag
from rosbags.rosbag1 import Writer

from tests.support.places import ROOT
from workers.readers import limited
from workers.readers.limited import ingest_limited
from workers.readers.limits import Limits
from workers.readers.normalised.sensor_files import SweepFile
from workers.readers.recording import ReadError


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("small") / "small.bag", interleaved(clouds(5), images(5)))


def noise(path, count, shape):
    """A bag of frames of noise, which take long to be packed as PNG."""
    pixels = np.random.default_rng(0).integers(0, 255, (*shape, 3), np.uint8)
    frames = (("/image", IMAGE, START_NS + i, raw_image(START_NS + i, pixels, "bgr8")) for i in range(count))
    return write_bag(path, [*clouds(2), *frames])


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """Takes some 4 s."""
    return noise(tmp_path_factory.mktemp("slow") / "slow.bag", 12, (4000, 2000))


def failure(source, out, *, limits=None, **how):
    with pytest.raises(ReadError) as caught:
        ingest_limited(source, out, {"cameras": ["front"]}, limits=Limits(**(limits or {})), **how)
    assert caught.value.message and caught.value.hint
    assert not out.exists()
    return caught.value


def children(pid):
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


# A process that was killed is gone when it is scheduled; one that was not lives for minutes.
GONE_S = 20


def gone_within(pid, seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except (FileNotFoundError, ProcessLookupError):
            return True
        time.sleep(0.02)
    return False


def test_a_manifest_comes_back_and_progress_with_it(small, tmp_path):
    seen = []
    request = {"cameras": {"front": "/camera/compressed"}, "options": {"point_times": "stamp_only"}}
    manifest = ingest_limited(small, tmp_path / "out", request, on_progress=seen.append)
    assert (seen[-1].done, seen[-1].total, seen[-1].share) == (10, 10, 1.0)
    assert [s.name for s in manifest.sensors] == ["lidar", "front"]
    assert manifest.sensors[0].time_source == "stamp_only"
    with SweepFile(tmp_path / "out" / "lidar.sweeps") as file:
        assert len(file) == 5


def test_the_readers_own_errors_come_through(small, tmp_path):
    error = failure(small.parent / "none.bag", tmp_path / "out", name="walk (2).bag")
    assert error.code == "recording_missing" and error.message.startswith("walk (2).bag is")
    for options in ({"rate_hz": -1}, {"speed": 3}):
        with pytest.raises(ReadError) as caught:
            ingest_limited(small, tmp_path / "out", {"options": options})
        assert caught.value.code == "request_invalid" and "point_times" in caught.value.hint


@pytest.mark.parametrize("stem", ["recording", "zip", "_"])
def test_only_the_files_own_name_becomes_its_owners(tmp_path, stem):
    with zipfile.ZipFile(tmp_path / stem, "w") as archive:
        archive.writestr("notes/recording.txt", "no recording, zip or _ of any kind")
    plain = failure(tmp_path / stem, tmp_path / "out")
    named = failure(tmp_path / stem, tmp_path / "out", name="мой файл")
    assert plain.message.startswith(f"{stem} ") and "recording" in plain.message[len(stem) :]
    assert named.message == "мой файл" + plain.message[len(stem) :]


def test_what_to_choose_from_comes_through(tmp_path):
    path = write_bag(tmp_path / "two.bag", interleaved(clouds(2), images(2), images(2, "/other/compressed")))
    error = failure(path, tmp_path / "out")
    assert error.code == "ambiguous_cameras" and error.fields["cameras"] == ["front"]
    assert [one["name"] for one in error.fields["candidates"]] == ["/camera/compressed", "/other/compressed"]


def test_memory(tmp_path):
    # 150 MB of zeros, which LZ4 packs into half a megabyte.
    pixels = np.zeros((15_000, 10_000), np.uint8)
    image = [("/image", IMAGE, START_NS, raw_image(START_NS, pixels, "mono8"))]
    path = write_bag(tmp_path / "bomb.bag", [*clouds(1), *image], Writer.CompressionFormat.LZ4)
    assert path.stat().st_size < 2_000_000
    error = failure(path, tmp_path / "out", limits={"memory_bytes": 448 * 1024**2})
    assert error.code == "recording_damaged" and "more than the memory" in error.message
    assert "let ingestions take more memory" in error.hint


@pytest.mark.parametrize(
    ("limits", "code", "reason"),
    [
        ({"memory_bytes": 64 * 1024**2}, "ingest_memory_limit", "64 MB"),
        ({"cpu_s": 1}, "ingest_cpu_limit", "1 s"),
        ({"file_bytes": 3 * 1024**2}, "ingest_file_limit", "3 MB"),
    ],
)
def test_what_a_recording_may_take(slow, tmp_path, limits, code, reason):
    error = failure(slow, tmp_path / "out", limits=limits)
    assert error.code == code and reason in error.message


class StopError(Exception):
    pass


def test_what_progress_raises_stops_the_child(slow, tmp_path):
    others = set(children(os.getpid()))
    running = []

    def cancel(progress):
        running.extend(set(children(os.getpid())) - others)
        raise StopError

    with pytest.raises(StopError):
        ingest_limited(slow, tmp_path / "out", {"cameras": ["front"]}, on_progress=cancel)
    assert running and all(gone_within(pid, 1) for pid in running)
    assert not (tmp_path / "out").exists()


@pytest.mark.faults
@pytest.mark.parametrize(("sent", "code"), [(signal.SIGKILL, "ingest_killed"), (signal.SIGSEGV, "ingest_crashed")])
def test_a_child_that_dies_is_explained(slow, tmp_path, sent, code):
    others = set(children(os.getpid()))

    def end_it(progress):
        for pid in set(children(os.getpid())) - others:
            os.kill(pid, sent)

    error = failure(slow, tmp_path / "out", on_progress=end_it)
    assert error.code == code
    assert code == "ingest_killed" or "SIGSEGV" in error.message


@pytest.mark.faults
def test_the_child_dies_with_its_parent(slow, tmp_path):
    script = (
        "import sys; from workers.readers.limited import ingest_limited\n"
        "ingest_limited(sys.argv[1], sys.argv[2], {}, on_progress=lambda *p: print('progress', flush=True))"
    )
    command = [sys.executable, "-c", script, str(slow), str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT) as parent:
        assert parent.stdout.readline() == b"progress\n"
        (child,) = children(parent.pid)
        parent.kill()
    assert gone_within(child, 2)


def test_the_child_sees_no_secrets_and_what_libraries_print_does_no_harm(small, tmp_path, monkeypatch):
    monkeypatch.setenv("APEXCAL_DATABASE_URL", "postgresql://user:secret@host")
    noise = "echo 'libpng warning'; echo 7; echo '[]'"
    stand_in(tmp_path, monkeypatch, f'env > {tmp_path}/env; {noise}; exec {sys.executable} "$@"')
    assert ingest_limited(small, tmp_path / "out", {}).sensors[0].count == 5
    environment = (tmp_path / "env").read_text()
    assert "OPENBLAS_NUM_THREADS=1" in environment and "user:secret" not in environment


@pytest.mark.faults
def test_what_a_killed_child_had_unpacked_is_removed(tmp_path):
    (tmp_path / "work").mkdir()
    bag = noise(tmp_path / "slow.bag", 4, (4000, 2000))
    with zipfile.ZipFile(tmp_path / "slow.zip", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.write(bag, "slow.bag")
    unpacked = []

    def kill(progress):
        unpacked.extend((tmp_path / "work").glob("unpacking-*/**/slow.bag"))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ingest_limited(tmp_path / "slow.zip", tmp_path / "work" / "out", {}, on_progress=kill)
    assert len(unpacked) == 1 and list((tmp_path / "work").iterdir()) == []


def test_a_folder_in_use_is_not_touched(small, tmp_path):
    (tmp_path / "precious").write_text("keep")
    with pytest.raises(ValueError, match="not empty"):
        ingest_limited(small, tmp_path, {})
    assert (tmp_path / "precious").read_text() == "keep"


def stand_in(tmp_path, monkeypatch, script):
    """What runs in the place of the child: a shell script, or Python without any limits of its own."""
    python = tmp_path / "stand-in"
    python.write_text(f"#!/bin/sh\n{script}\n")
    python.chmod(0o755)
    monkeypatch.setattr(limited.sys, "executable", str(python))


def pids_in(file):
    return [int(line) for line in file.read_text().split()] if file.exists() else []


HOPELESS = {
    "silent": ("sleep 300 & echo $$ $! > {pids}; wait", {"silence_s": 1.0}, "ingest_silent"),
    "slow": (
        """sleep 300 & echo $$ $! > {pids}; while :; do echo '{{"beat": true}}'; sleep 0.1; done""",
        {"wall_s": 1.5},
        "ingest_time_limit",
    ),
    "closes its pipes": ("echo $$ > {pids}; exec >&- 2>&-; exec sleep 300", {"wall_s": 1.5}, "ingest_time_limit"),
    "talks": ("echo $$ > {pids}; exec yes progress", {}, "ingest_crashed"),
    "one long line": ("echo $$ > {pids}; exec tr '\\0' x < /dev/zero", {}, "ingest_crashed"),
    "complains": ("echo $$ > {pids}; exec yes warning >&2", {"wall_s": 1.5}, "ingest_time_limit"),
    "writes": (
        "echo $$ > {pids}; exec dd if=/dev/zero of=$4/lidar.mcap bs=1M count=2000 status=none",
        {"output_floor_bytes": 30 * 1024**2},
        "ingest_output_limit",
    ),
}


@pytest.mark.parametrize("kind", HOPELESS)
def test_a_child_that_does_not_end_is_ended_with_all_that_it_started(small, tmp_path, monkeypatch, kind):
    script, limits, code = HOPELESS[kind]
    stand_in(tmp_path, monkeypatch, script.format(pids=tmp_path / "pids"))
    began = time.monotonic()
    error = failure(small, tmp_path / "out", limits=limits)
    assert error.code == code and "small.bag" in error.message
    # The machine may be busy; what never ends would take five minutes.
    assert time.monotonic() - began < 60
    pids = pids_in(tmp_path / "pids")
    assert pids and all(gone_within(pid, GONE_S) for pid in pids)
    assert sum(len(error_note) for error_note in getattr(error, "__notes__", [])) < 5000


def test_work_without_messages_is_no_silence(tmp_path):
    """A zip is unpacked, an index is read: that takes its time, and the child says so."""
    bag = write_bag(tmp_path / "walk.bag", interleaved(clouds(5), images(5)))
    beats = []
    real = limited._Ingestion._take

    def take(self, line):
        beats.append(b"beat" in line)
        real(self, line)

    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.write(bag, "walk.bag")
    limited._Ingestion._take = take
    try:
        ingest_limited(tmp_path / "walk.zip", tmp_path / "out", {})
    finally:
        limited._Ingestion._take = real
    assert any(beats)


def test_the_reserve_is_kept_while_writing(tmp_path):
    """On a disk of its own, for others write on the machine's."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "apexcal", str(disk)], check=False)
    if mounted.returncode != 0:
        pytest.skip("only root may mount a small disk here")
    try:
        source = noise(tmp_path / "large.bag", 16, (1000, 1000))
        free, reserve = [], 32 * 1024**2
        watch = {"must_stop": lambda: free.append(shutil.disk_usage(disk).free)}
        error = failure(source, disk / "out", limits={"reserve_bytes": reserve}, **watch)
        assert error.code == "ingest_disk_full"
        assert min(free) >= reserve and shutil.disk_usage(disk).free > 60 * 1024**2
        manifest = ingest_limited(source, disk / "out", {"cameras": ["front"]}, limits=Limits())
        assert manifest.sensors[1].count == 16
    finally:
        subprocess.run(["umount", str(disk)], check=True)
