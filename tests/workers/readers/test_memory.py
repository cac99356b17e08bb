"""An ingestion needs no more memory for a long recording than for a short one."""

import json
import shutil
import subprocess
import sys

import pytest
from making_long import long_bag, long_pcap, long_tar

from tests.support.places import ROOT
from workers.readers.__main__ import _used

MB = 1_000_000
# Writers, and the sizes of the short form: a capture's megabyte holds five times as many messages as a bag's.
KINDS = {
    "bag": (long_bag, 25 * MB, 75 * MB),
    "pcap": (long_pcap, 5 * MB, 15 * MB),
    "tar": (long_tar, 25 * MB, 75 * MB),
}


def peak(path, out):
    """Highest resident memory of an ingestion, bytes."""
    command = [sys.executable, "-m", "workers.readers", str(path), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    last = json.loads(done.stdout.splitlines()[-1])
    assert "used" in last, (last, done.stderr)
    shutil.rmtree(out)
    path.unlink()
    return last["used"]["resident_bytes"]


@pytest.mark.parametrize("kind", KINDS)
def test_memory_does_not_grow_with_the_recording(tmp_path, kind):
    write, small, large = KINDS[kind]
    first = peak(write(tmp_path / "small", small), tmp_path / "out")
    second = peak(write(tmp_path / "large", large), tmp_path / "out")
    assert second < 300 * MB
    assert second - first < 12 * MB, (first, second)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_four_gigabytes(tmp_path, kind):
    assert peak(KINDS[kind][0](tmp_path / "long", 4_000 * MB), tmp_path / "out") < 400 * MB


def test_a_reader_that_may_not_read_its_own_status_still_answers(monkeypatch):
    def refuse(path, *_, **__):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("pathlib.Path.read_text", refuse)
    used = _used()
    assert used["resident_bytes"] > 10_000_000 and used["cpu_s"] > 0.0
