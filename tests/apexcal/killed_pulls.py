"""`apexcal pull` in children that end themselves, as SIGKILL does, before the n-th line of what it executes.

``python -m tests.apexcal.killed_pulls FOLDER SAVED STRIDE ROOM WORDS...``: SAVED is the folder's state before
each pull. ROOM limits the bytes that may be written; -1 is no limit. Prints one line of JSON: how many were killed,
what the file then held (SHA-256, and whether it is known as pulled), and how the last one, which was not killed,
ended.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sys
from hashlib import sha256
from pathlib import Path
from types import FrameType
from typing import Any

from apexcal import kept_file, transport
from apexcal.cli import app
from apexcal.commands import connect, pull

_WATCHED = {one.__file__ for one in (pull, kept_file, connect, transport)}
_MOST = 2000


def _pull(words: list[str], moment: int, room: int) -> None:
    left = moment

    def watch(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal left
        if frame.f_code.co_filename not in _WATCHED:
            return None
        left -= event == "line"
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return watch

    if room >= 0:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    sys.settrace(watch)
    try:
        app(words)
    except SystemExit as end:
        os._exit(int(end.code or 0))
    os._exit(99)


def main() -> None:
    """Kill at every STRIDE-th line, until one ends by itself."""
    folder, saved, stride, room, *words = sys.argv[1:]
    path = Path(folder) / "calibration.json"
    found, left_behind = set[tuple[str, bool]](), 0
    for killed, moment in enumerate(range(1, _MOST, int(stride))):
        shutil.rmtree(folder)
        shutil.copytree(saved, folder)
        child = os.fork()
        if child == 0:
            _pull(words, moment, int(room))
        status = os.waitpid(child, 0)[1]
        there = sha256(path.read_bytes()).hexdigest() if path.exists() else "nothing"
        found.add((there, kept_file.KeptFile(path).is_whole()))
        left_behind += len(list(Path(folder).glob(".*.part")))
        if os.WIFEXITED(status):
            ended = {"exit_code": os.WEXITSTATUS(status), "there": there}
            print(json.dumps({"killed": killed, "found": sorted(found), "left_behind": left_behind, **ended}))
            return
        assert os.WTERMSIG(status) == signal.SIGKILL


if __name__ == "__main__":
    main()
