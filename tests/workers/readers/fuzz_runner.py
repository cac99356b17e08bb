"""Runs the ingestion's own child on one file after another, each in a fork of a process that has imported everything.

A fork takes some 10 ms where a new interpreter takes 500. Reads lines of JSON (``source``, ``out``) and answers each
with what became of it.
"""

import contextlib
import importlib
import json
import os
import pkgutil
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from pathlib import Path

MEMORY_BYTES = 2 * 1024**3  # address space; the libraries alone take over 1 GB of it
RESIDENT_BYTES = 500 * 1024**2
CPU_S = 5
# A child has 5 s of processor time; beside other work on the machine these take longer by the clock.
WALL_S = 60
FILE_BYTES = 256 * 1024**2
OUTPUT_RATIO, VIDEO_RATIO, FLOOR_BYTES = 20, 300, 4 * 1024**2
RESERVE_BYTES = 512 * 1024**2


def warm():
    """Import every reader, and what they import only when a format is met."""
    import workers.readers

    for module in pkgutil.iter_modules(workers.readers.__path__):
        if module.name != "__main__":
            importlib.import_module(f"workers.readers.{module.name}")
    for name in ("av", "cv2", "velodyne_decoder", "pypcd4", "rosbags.highlevel", "mcap.reader", "lz4.frame"):
        importlib.import_module(name)
    return importlib.import_module("workers.readers.__main__").main


def limits_for(source):
    """What the real starter would say of a file of this size."""
    size = Path(source).stat().st_size
    return {
        "memory_bytes": MEMORY_BYTES,
        "cpu_s": CPU_S,
        "file_bytes": FILE_BYTES,
        "output_bytes": FLOOR_BYTES + OUTPUT_RATIO * size,
        "video_output_bytes": FLOOR_BYTES + VIDEO_RATIO * size,
        "reserve_bytes": RESERVE_BYTES,
    }


def stored(*folders):
    """Bytes in folders whose files come and go."""
    count = 0
    for folder in folders:
        for place, _, files in os.walk(folder):
            for name in files:
                with contextlib.suppress(FileNotFoundError):
                    count += (Path(place) / name).lstat().st_size
    return count


def child(main, case, said, errors):
    """What the forked process does; it never returns."""
    code = 70
    try:
        os.dup2(errors.fileno(), 2)
        sys.stdout = said
        parent = ["--parent", str(os.getppid()), "--limits", json.dumps(limits_for(case["source"]))]
        code = main([case["source"], case["out"], *parent])
        said.flush()
    except SystemExit as end:
        code = 71 if end.code is None else end.code
    except BaseException:
        os.write(2, traceback.format_exc().encode())
    finally:
        os._exit(code)


def run(main, case, folder):
    """One file; ``last`` is the last line that the child said, ``stored`` the most that lay on the disk for it."""
    scratch = Path(tempfile.gettempdir())
    with (folder / "said").open("w+") as said, (folder / "errors").open("w+") as errors:
        started = time.monotonic()
        pid = os.fork()
        if pid == 0:
            child(main, case, said, errors)
        hung = False
        most = 0
        while True:
            done, status, usage = os.wait4(pid, os.WNOHANG)
            if done:
                break
            most = max(most, stored(case["out"], scratch))
            if time.monotonic() - started > WALL_S and not hung:
                hung = True
                os.kill(pid, signal.SIGKILL)
            time.sleep(0.002)
        said.seek(0)
        errors.seek(0)
        lines = said.read().splitlines()
        return {
            "code": os.waitstatus_to_exitcode(status),
            "hung": hung,
            "stored": max(most, stored(case["out"], scratch)),
            "free": shutil.disk_usage(folder).free,
            "resident": usage.ru_maxrss * 1024,
            "seconds": usage.ru_utime + usage.ru_stime,
            "last": json.loads(lines[-1]) if lines else {},
            "errors": errors.read(),
        }


def serve():
    """Answer until the lines end."""
    main = warm()
    folder = Path(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for line in sys.stdin:
        print(json.dumps(run(main, json.loads(line), folder)), flush=True)


if __name__ == "__main__":
    serve()
