import json
import os
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

from workers.readers import limited
from workers.readers.limited import ingest_limited
from workers.readers.limits import Limits
from workers.readers.normalised.lidar_file import LidarFile
from workers.readers.recording import ReadError

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("small") / "small.bag", interleaved(clouds(5), images(5)))


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """Takes some 4 s: noise to be packed as PNG, 24 megapixels over and over."""
    pixels = np.random.default_rng(0).integers(0, 255, (4000, 2000, 3), np.uint8)
    frames = (("/image", IMAGE, START_NS + i, raw_image(START_NS + i, pixels, "bgr8")) for i in range(12))
    return write_bag(tmp_path_factory.mktemp("slow") / "slow.bag", [*clouds(2), *frames])


def failure(source, out, *, name=None, on_progress=None, must_stop=None, **limits):
    with pytest.raises(ReadError) as caught:
        ingest_limited(
            *(source, out, {"cameras": ["front"]}),
            limits=Limits(**limits),
            name=name,
            on_progress=on_progress,
            must_stop=must_stop,
        )
    assert caught.value.message and caught.value.hint
    assert not out.exists()
    return caught.value


def children(pid):
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


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
    with LidarFile(tmp_path / "out" / "lidar.mcap") as file:
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
    error = failure(path, tmp_path / "out", memory_bytes=448 * 1024**2)
    assert error.code == "recording_damaged" and "more than the memory" in error.message
    assert "let ingestions take more memory" in error.hint


def test_memory_too_small_for_the_libraries(small, tmp_path):
    assert failure(small, tmp_path / "out", memory_bytes=64 * 1024**2).code == "ingest_memory_limit"


def test_processor_time(slow, tmp_path):
    error = failure(slow, tmp_path / "out", cpu_s=1)
    assert error.code == "ingest_cpu_limit" and "1 s" in error.message


def test_file_size(slow, tmp_path):
    error = failure(slow, tmp_path / "out", file_bytes=3 * 1024**2)
    assert error.code == "ingest_file_limit" and "3 MB" in error.message


def test_what_progress_raises_stops_the_child(slow, tmp_path):
    class CancelledError(Exception):
        pass

    others = set(children(os.getpid()))
    running = []

    def cancel(progress):
        running.extend(set(children(os.getpid())) - others)
        raise CancelledError

    with pytest.raises(CancelledError):
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


def test_the_child_sees_no_secrets(small, tmp_path, monkeypatch):
    monkeypatch.setenv("APEXCAL_DATABASE_URL", "postgresql://user:secret@host")
    # A tracing stand-in for the interpreter: writes its environment where the child would have worked.
    spy = tmp_path / "python"
    spy.write_text(f'#!/bin/sh\nenv > {tmp_path}/env\nexec {sys.executable} "$@"\n')
    spy.chmod(0o755)
    monkeypatch.setattr(limited.sys, "executable", str(spy))
    ingest_limited(small, tmp_path / "out", {})
    told = (tmp_path / "env").read_text()
    assert "OPENBLAS_NUM_THREADS=1" in told and "user:secret" not in told


@pytest.mark.faults
def test_what_a_killed_child_had_unpacked_is_removed(tmp_path):
    (tmp_path / "work").mkdir()
    pixels = np.random.default_rng(0).integers(0, 255, (4000, 2000, 3), np.uint8)
    frames = (("/image", IMAGE, START_NS + i, raw_image(START_NS + i, pixels, "bgr8")) for i in range(4))
    bag = write_bag(tmp_path / "slow.bag", [*clouds(2), *frames])
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


def test_the_command_prints_json_lines(small, tmp_path):
    command = [sys.executable, "-m", "workers.readers", str(small), str(tmp_path / "out"), "--request"]
    done = subprocess.run([*command, '{"cameras": ["front"]}'], capture_output=True, text=True, cwd=ROOT, check=True)
    *progress, last = [json.loads(line) for line in done.stdout.splitlines()]
    assert progress[-1] == {"progress": {"done": 10, "total": 10, "share": 1.0, "seconds_left": None}}
    assert last["manifest"]["sensors"][1]["name"] == "front"
    failed = subprocess.run([*command, '{"lidar": "/no"}'], capture_output=True, text=True, cwd=ROOT, check=False)
    assert failed.returncode == 1
    error = json.loads(failed.stdout.splitlines()[-1])["error"]
    assert error["code"] == "topic_not_found" and error["fields"]["candidates"][0]["name"] == "/points"


def test_what_libraries_print_does_no_harm(small, tmp_path, monkeypatch):
    noisy = tmp_path / "python"
    noisy.write_text(f"#!/bin/sh\necho 'libpng warning'; echo 7; echo '[]'\nexec {sys.executable} \"$@\"\n")
    noisy.chmod(0o755)
    monkeypatch.setattr(limited.sys, "executable", str(noisy))
    assert ingest_limited(small, tmp_path / "out", {}).sensors[0].count == 5
