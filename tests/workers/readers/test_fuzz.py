"""Damaged files of every format, through the child that reads uploads: an answer for each, and never a crash."""

import json
import os
import random
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from formats import tar_of, zip_of
from fuzz_mutations import mutate
from fuzz_runner import MEMORY_BYTES, RESERVE_BYTES, RESIDENT_BYTES, limits_for
from fuzz_seeds import REPACKED, make_whole, members
from making_bombs import BOMBS
from making_recordings import png

from tests.support.places import ROOT
from workers.readers.normalised.manifest import RecordingManifest
from workers.readers.normalised.sensor_files import FrameFile, SweepFile

RUNNER = Path(__file__).with_name("fuzz_runner.py")
LONG = [pytest.mark.slow, pytest.mark.timeout(7200)]
SHORT_AND_LONG = [range(90), pytest.param(range(90, 10_090), marks=LONG)]


class Runner:
    """The warmed process; see fuzz_runner."""

    def __init__(self, folder):
        self.source, self.out = folder / "upload", folder / "out"
        environment = os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(folder / "scratch")}
        environment |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")
        (folder / "scratch").mkdir()
        self.process = subprocess.Popen(
            [sys.executable, str(RUNNER), str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=ROOT,
        )

    def __call__(self, data):
        self.source.write_bytes(data)
        shutil.rmtree(self.out, ignore_errors=True)
        self.out.mkdir()
        self.process.stdin.write(json.dumps({"source": str(self.source), "out": str(self.out)}) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def close(self):
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait(timeout=30)


@pytest.fixture(scope="module")
def runner(tmp_path_factory):
    running = Runner(tmp_path_factory.mktemp("fuzz"))
    yield running
    running.close()


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    return make_whole(tmp_path_factory.mktemp("seeds"))


def complaint(result, runner):
    """What is wrong with what became of a file, or None."""
    if result["hung"] or result["code"] == -24:
        return "it hung"
    if result["code"] not in (0, 1) or "Traceback" in result["errors"]:
        return f"it crashed with {result['code']}: {result['errors'][-3000:]}"
    if result["stored"] > limits_for(runner.source)["video_output_bytes"]:
        return f"it stored {result['stored']} bytes of {runner.source.stat().st_size}"
    if result["free"] < RESERVE_BYTES:
        return f"it left {result['free']} bytes free"
    if result["resident"] > RESIDENT_BYTES:
        return f"it took {result['resident'] / 1e6:.0f} MB"
    if result["code"] == 0:
        return broken_output(result["last"], runner.out)
    error = result["last"].get("error")
    if not error or not error["code"]:
        return f"no reason was given: {result['last']}"
    if runner.out.is_dir() and any(runner.out.iterdir()):
        return "it was refused, and half of it stayed"
    if error["code"] == "ingest_memory_limit":
        return f"it asked for more than {MEMORY_BYTES / 1e9:.1f} GB"
    if error["code"] in ("ingest_output_limit", "ingest_disk_full"):  # its starter finds the words
        return None
    if not error["message"].endswith(".") or len(error["hint"]) < 10:
        return f"no sentences: {error}"
    if str(runner.source.parent) in str(error) or len(error["message"]) > 8000:
        return f"not for people: {error}"
    return None


def broken_output(last, out):
    """What a manifest says must be there, whole, and usable without another look."""
    manifest = RecordingManifest.model_validate(last["manifest"])
    with SweepFile(out / manifest.sensors[0].file) as lidar:
        if len(lidar) != manifest.sensors[0].count:
            return "the table and the file differ"
        for sweep in lidar.sweeps():
            if not np.isfinite(sweep.xyz).all() or (len(sweep.ring) and sweep.ring.max() >= lidar.ring_count):
                return "points that are none"
    for sensor in manifest.sensors:
        with (SweepFile if sensor.kind == "lidar" else FrameFile)(out / sensor.file) as file:
            if len(file) != sensor.count:
                return "the manifest and the file differ"
    return None


def damaged(seeds, number):
    """Case ``number``: its format, and the bytes."""
    rng = random.Random(number)
    name = [*seeds, *REPACKED][number % (len(seeds) + len(REPACKED))]
    if name in seeds:
        whole = rng.choice(seeds[name])
        return name, mutate(whole, seeds[name], number)
    pack, members = REPACKED[name]
    files = members()
    chosen = rng.choice(list(files))
    alike = [data for path, data in files.items() if path.rpartition(".")[2] == chosen.rpartition(".")[2]]
    return name, pack(files | {chosen: mutate(files[chosen], alike, number)})


def check(runner, seeds, numbers):
    complaints = []
    for number in numbers:
        name, data = damaged(seeds, number)
        said = complaint(runner(data), runner)
        if said:
            complaints.append(f"case {number} ({name}, {zlib.crc32(data):08x}): {said}")
    assert not complaints, "\n".join(complaints)


# Of these the short form is within the limits.
READ = ("flat_images", "many_frames", "claiming_clouds")
TOO_MUCH = ("sqlite_not_plain", "recording_damaged", "ingest_output_limit", "archive_expands")


def test_whole_files_are_read_and_bombs_neither_fill_the_disk_nor_keep_a_worker(runner, seeds):
    kinds = iter(BOMBS)
    for name, files in seeds.items():
        for data in files:
            result = runner(data)
            assert complaint(result, runner) is None, (name, result)
            if name == "video":  # no LiDAR: it is refused after it was opened
                assert result["last"]["error"]["code"] == "no_lidar_topic", result
            elif name != "bombs":
                assert result["code"] == 0, (name, result)
            elif next(kinds) not in READ:
                assert result["last"]["error"]["code"] in TOO_MUCH, result
    for name, (pack, made) in REPACKED.items():
        result = runner(pack(made()))
        assert result["code"] == 0, (name, result)


@pytest.mark.parametrize("numbers", SHORT_AND_LONG)
def test_damaged_files_are_read_or_refused(runner, seeds, numbers):
    check(runner, seeds, numbers)


ONCE = {
    "a PNG that ends inside its header": lambda: tar_of(members() | {"images/0.png": png(8, 6)[:25]}),
    "a zip with a file without a name": lambda: zip_of({"": b"nothing"}),
    "a zip whose directory points before its beginning": lambda: zip_of(members())[40:],
}


@pytest.mark.parametrize("kind", ONCE)
def test_what_once_crashed_is_refused_or_left_out(runner, kind):
    result = runner(ONCE[kind]())
    assert (result["code"], complaint(result, runner)) == (0 if "PNG" in kind else 1, None), result
