"""A kept file under a writer that is killed at every line, a disk that takes no more, and hands that edit it."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from apexcal.kept_file import KeptFile

OLD, NEW = b"old " * 5000, b"new, and longer " * 5000

# A child for each moment: it ends itself, as SIGKILL does, before the n-th line that the module executes.
_KILL_AT_EVERY_LINE = """
import os, signal, sys
from pathlib import Path
from apexcal import kept_file
path, OLD, NEW = Path(sys.argv[1]), b"old " * 5000, b"new, and longer " * 5000
seen = set()
left_behind = 0
for moment in range(1, 1000):
    for part in path.parent.glob(".*.part"):
        part.unlink()
        left_behind += 1
    kept_file.KeptFile(path).replace(OLD, "E-old", "asked")
    child = os.fork()
    if child == 0:
        left = moment
        def watch(frame, event, argument):
            global left
            if frame.f_code.co_filename != kept_file.__file__:
                return None
            left -= event == "line"
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return watch
        sys.settrace(watch)
        kept_file.KeptFile(path).replace(NEW, "E-new", "asked")
        sys.settrace(None)
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    kept = kept_file.KeptFile(path)
    found = {OLD: "E-old", NEW: "E-new"}[path.read_bytes()]
    assert kept.etag("asked") == found and kept.is_whole(), (moment, found, kept.etag("asked"))
    seen.add(found)
    if status == 0:
        print(moment, left_behind, *sorted(seen))
        break
    assert os.WTERMSIG(status) == signal.SIGKILL
"""


def test_killed_before_any_line_it_is_the_old_file_or_the_new_one(tmp_path):
    path = tmp_path / "calibration.json"
    ran = subprocess.run(
        [sys.executable, "-c", _KILL_AT_EVERY_LINE, str(path)], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    moments, left_behind, *seen = ran.stdout.split()
    assert int(moments) > 30 and int(left_behind) > 5 and seen == ["E-new", "E-old"]


def test_what_the_killed_left_goes_when_it_is_nobodys_any_more(tmp_path):
    for name in (".calibration.json.old.part", ".calibration.json.new.part", ".other.json.old.part"):
        (tmp_path / name).write_bytes(b"half")
        if ".old." in name:
            os.utime(tmp_path / name, (time.time() - 7200,) * 2)
    KeptFile(tmp_path / "calibration.json").replace(OLD, "E-old", "asked")
    assert sorted(one.name for one in tmp_path.iterdir()) == [
        ".calibration.json.new.part", ".calibration.json.pulled", ".other.json.old.part", "calibration.json"
    ]  # fmt: skip


_WITHOUT_ROOM = """
import resource, sys
from pathlib import Path
from apexcal.kept_file import KeptFile
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]),) * 2)
try:
    KeptFile(Path(sys.argv[1])).replace(b"new, and longer " * 5000, "E-new", "asked")
except OSError as error:
    print(error.strerror)
    sys.exit(7)
"""


@pytest.mark.parametrize("room", [0, 100, 40_000])
def test_a_disk_that_takes_no_more_leaves_the_old_file(tmp_path, room):
    """No room for the note, for a part of it, and for the note but not for the file."""
    kept = KeptFile(tmp_path / "calibration.json")
    kept.replace(OLD, "E-old", "asked")
    ran = subprocess.run(
        [sys.executable, "-c", _WITHOUT_ROOM, str(kept.path), str(room)], capture_output=True, check=False
    )
    assert ran.returncode == 7, ran.stderr
    assert kept.path.read_bytes() == OLD and kept.etag("asked") == "E-old"
    assert not list(tmp_path.glob(".*.part"))


def test_what_was_edited_or_asked_otherwise_is_not_known(tmp_path):
    kept = KeptFile(tmp_path / "calibration.json")
    assert kept.etag("asked") is None and not kept.is_whole()
    kept.replace(OLD, "E-old", "asked")
    assert kept.etag("asked") == "E-old" and kept.etag("asked otherwise") is None
    kept.path.write_bytes(OLD[:-1])
    assert kept.etag("asked") is None and not kept.is_whole()
    kept.replace(NEW, "E-new", "asked")
    assert kept.etag("asked") == "E-new"
    kept.path.with_name(".calibration.json.pulled").write_text("{half")
    assert kept.etag("asked") is None
