"""`python -m benchmarks.readers`: our readers of containers beside the libraries that read them too.

For each way of reading it measures: processor seconds to import it and to read a simulated walk (SECONDS), the share
of messages saved from the walk's damaged copies (DAMAGED of each kind), and the cost of files made to exhaust a
reader. Each reading runs in its own process, with the limits of an ingestion: 3 GiB of memory, here 20 s of processor
time.

"Saved" is the share of messages that are read as written before the file ends or the reader gives up. In the product,
a reader that raises gives up the whole recording, so the share of files read to an end is given too.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
import zlib
from collections import Counter
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks.readers.ways import WAYS

_MEMORY_BYTES = 3 * 1024**3
_CPU_S = 20
_ROUNDS = 5


def read_here(container: str, way: str, path: Path, known: Counter[int] | None) -> dict[str, Any]:
    """Read a file in this process; ``known`` are the contents that count as saved."""
    found: Counter[int] = Counter()
    size, error = 0, ""
    began, wall = time.process_time(), time.monotonic()
    try:
        for _, data in WAYS[container][way](path):
            size += len(data)
            if known is not None:
                found[zlib.crc32(data)] += 1
    except MemoryError:
        error = "MemoryError"
    except Exception as raised:  # anything else that a library raises is its answer to the file
        error = f"{type(raised).__name__}: {raised}"[:90]
    status = Path("/proc/self/status").read_text().splitlines()
    peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM:")) * 1024
    return {
        "cpu_s": time.process_time() - began,
        "wall_s": time.monotonic() - wall,
        "bytes": size,
        "saved": (known & found).total() if known is not None else 0,
        "peak": peak,
        "error": error,
    }


def read_apart(container: str, way: str, path: Path, known: Counter[int] | None = None) -> dict[str, Any]:
    """The same in a fork of this process, within limits."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))
        resource.setrlimit(resource.RLIMIT_CPU, (_CPU_S, _CPU_S + 1))
        os.write(writing, json.dumps(read_here(container, way, path, known)).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as answer:
        said = answer.read()
    _, status, used = os.wait4(pid, 0)
    if said:
        return json.loads(said)
    code = os.waitstatus_to_exitcode(status)
    return {
        "cpu_s": used.ru_utime + used.ru_stime,
        "peak": used.ru_maxrss * 1024,
        "error": f"killed ({code})",
        "saved": 0,
    }


def import_s(container: str, way: str, path: Path) -> float:
    """Processor seconds of a fresh process up to the first message, beyond an interpreter with NumPy."""
    code = (
        "import sys, time, numpy\nfrom pathlib import Path\nfrom benchmarks.readers.ways import WAYS\n"
        "t = time.process_time()\nnext(WAYS[sys.argv[1]][sys.argv[2]](Path(sys.argv[3])))\n"
        "print(time.process_time() - t)"
    )
    command = [sys.executable, "-c", code, container, way, str(path)]
    return median(float(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout) for _ in range(3))


def contents(container: str, way: str, path: Path) -> Counter[int]:
    """The checksums of all messages of a whole file."""
    return Counter(zlib.crc32(data) for _, data in WAYS[container][way](path))


def main() -> None:
    """Print the figures as JSON."""
    from benchmarks.readers import files

    seconds, count = float(os.environ.get("SECONDS", "20")), int(os.environ.get("DAMAGED", "60"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = files.whole(folder, seconds)
        for container, ways in WAYS.items():
            path = made[container]
            print(json.dumps({"container": container, "MB": round(path.stat().st_size / 1e6, 1)}))
            runs: dict[str, list[dict[str, Any]]] = {way: [] for way in ways}
            for _ in range(_ROUNDS):
                for way in ways:
                    runs[way].append(read_apart(container, way, path))
            known = {way: contents(container, way, path) for way in ways}
            marks = {way: {"cut": [], "noise": []} for way in ways}
            for kind, broken in files.damaged(path, folder, count):
                for way in ways:
                    marks[way][kind].append(read_apart(container, way, broken, known[way]))
            for way in ways:
                cpu = median(run["cpu_s"] for run in runs[way])
                total = known[way].total()
                figures = {
                    "way": way,
                    "first_message_s": round(import_s(container, way, path), 3),
                    "cpu_s": round(cpu, 3),
                    "MB_per_cpu_s": round(runs[way][0]["bytes"] / 1e6 / cpu),
                    "peak_MB": round(runs[way][0]["peak"] / 1e6),
                }
                for kind, results in marks[way].items():
                    figures[f"saved_of_{kind}"] = round(sum(r["saved"] for r in results) / total / len(results), 3)
                    figures[f"to_an_end_of_{kind}"] = round(sum(not r["error"] for r in results) / len(results), 2)
                    figures[f"errors_of_{kind}"] = dict(
                        Counter(r["error"].split(":")[0] for r in results if r["error"]).most_common(6)
                    )
                    figures[f"peak_MB_of_{kind}"] = round(max(r["peak"] for r in results) / 1e6)
                print(json.dumps(figures), flush=True)
        for container, what, path in files.bombs(made, folder):
            for way in WAYS[container]:
                one = read_apart(container, way, path)
                print(
                    json.dumps({"bomb": what, "way": way, **{k: one[k] for k in ("cpu_s", "peak", "error")}}),
                    flush=True,
                )
        for container, path in files.real():
            for way in WAYS[container]:
                one = read_apart(container, way, path)
                print(json.dumps({"real": path.name, "way": way, "bytes": one.get("bytes"), "error": one["error"]}))


if __name__ == "__main__":
    main()
