"""`apexcal pull`, looked at before each line of what it executes, and killed before some of them.

``python -m tests.apexcal.killed_pulls FOLDER SAVED KILLS ROOM WORDS...``: SAVED is the folder's state before each
pull. ROOM limits the bytes that may be written; -1 is no limit. A kill leaves in the folder what lies there at that
moment, so one pull shows what a kill before any of its lines leaves. KILLS other pulls end themselves, as SIGKILL
does, spread over these lines, and each must leave what was seen there. Prints one line of JSON: the number of lines,
what the file held (SHA-256, and whether it is known as pulled), the most files left behind, and how the pull ended.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import sys
from collections.abc import Callable
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any

from apexcal import kept_file, transport
from apexcal.cli import app
from apexcal.commands import pull, session

_WATCHED = {one.__file__ for one in (pull, kept_file, session, transport)}
# Loaded with the first request: here once for all pulls.
for _later in ("httpcore", "anyio"):
    import_module(_later)

Left = tuple[str, bool, int]


def _left(path: Path) -> Left:
    """What lies in the folder: the file's hash, whether it is known as pulled, and how many unfinished files."""
    there = sha256(path.read_bytes()).hexdigest() if path.exists() else "nothing"
    return there, kept_file.KeptFile(path).is_whole(), len(list(path.parent.glob(".*.part")))


def _pull(words: list[str], room: int, before_line: Callable[[int], None]) -> None:
    """In a child, which it ends."""
    line = 0

    def watch(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal line
        if frame.f_code.co_filename not in _WATCHED:
            return None
        if event == "line":
            line += 1
            sys.settrace(None)
            before_line(line)
            sys.settrace(watch)
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
        sys.settrace(None)
        os._exit(int(end.code or 0))
    os._exit(99)


def _looked(path: Path, words: list[str], room: int) -> tuple[list[Left], int]:
    """What lies there before each line, and the exit code. The child tells it through a pipe, which has no limit."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _pull(words, room, lambda line: _tell(writing, _left(path)))
    os.close(writing)
    with os.fdopen(reading) as told:
        seen = [(there, whole, parts) for there, whole, parts in map(json.loads, told)]
    return seen, os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _tell(pipe: int, left: Left) -> None:
    os.write(pipe, json.dumps(left).encode() + b"\n")


def _killed(words: list[str], room: int, moment: int) -> None:
    """A pull that is killed before this line."""
    child = os.fork()
    if child == 0:
        _pull(words, room, lambda line: os.kill(os.getpid(), signal.SIGKILL) if line == moment else None)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def main() -> None:
    """Look at one pull, then kill others."""
    folder, saved, kills, room, *words = sys.argv[1:]
    path = Path(folder) / "calibration.json"

    def again() -> None:
        shutil.rmtree(folder)
        shutil.copytree(saved, folder)

    again()
    seen, exit_code = _looked(path, words, int(room))
    ended = _left(path)
    # The lines that change what lies there are few, so the kills stand close to these too.
    changes = [n for n in range(1, len(seen)) if seen[n] != seen[n - 1]]
    spread = {1 + n * (len(seen) - 1) // int(kills) for n in range(int(kills))}
    for moment in sorted(spread | {n + k for n in changes for k in (0, 1)}):
        again()
        _killed(words, int(room), moment)
        assert _left(path) == seen[moment - 1], f"a kill before line {moment}"
    found = sorted({(there, whole) for there, whole, _ in [*seen, ended]})
    left_behind = max(parts for _, _, parts in seen)
    said = {"lines": len(seen), "found": found, "left_behind": left_behind, "exit_code": exit_code, "there": ended[0]}
    print(json.dumps(said))


if __name__ == "__main__":
    main()
