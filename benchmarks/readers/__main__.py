"""`python -m benchmarks.readers`: our readers of containers beside the libraries that read them too.

A line of JSON for each way of reading SECONDS of a simulated walk (20) and DAMAGED copies of each kind (60):
processor seconds (median of three); of copies that are cut, or have 16 bytes of noise, the shares of messages
saved and of files that raised nothing. Then a line for each file made to exhaust a reader. Each reading runs in
its own process with the limits of an ingestion: 3 GiB of memory, here 20 s of processor time.
"""

from __future__ import annotations

import json
import os
import resource
import tempfile
import zlib
from collections import Counter
from pathlib import Path
from statistics import mean, median
from typing import Any

from benchmarks.readers import files
from benchmarks.readers.ways import WAYS

_MEMORY_BYTES = 3 * 1024**3
_CPU_S = 20


def read_apart(container: str, way: str, path: Path) -> dict[str, Any]:
    """Read a file in a fork with limits: how many messages of which content, the error, and what it took."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))
        resource.setrlimit(resource.RLIMIT_CPU, (_CPU_S, _CPU_S))
        contents, error = Counter[int](), ""
        try:
            contents.update(zlib.crc32(data) for data in WAYS[container][way](path))
        except Exception as raised:  # whatever a library raises is its answer to the file
            error = f"{type(raised).__name__}: {raised}"[:90]
        with os.fdopen(writing, "w") as answer:
            json.dump([list(contents.items()), error], answer)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as answer:
        line = answer.read()
    _, status, used = os.wait4(pid, 0)
    pairs, error = json.loads(line) if line else ([], f"killed ({os.waitstatus_to_exitcode(status)})")
    cpu_s = round(used.ru_utime + used.ru_stime, 3)
    peak = round(used.ru_maxrss / 1024)
    return {"contents": Counter(dict(pairs)), "error": error, "cpu_s": cpu_s, "peak_MB": peak}


def saved(whole: Counter[int], results: list[dict[str, Any]]) -> dict[str, float]:
    """Mean share of a whole file's messages that were read, and share of files that raised nothing."""
    shares = mean((whole & result["contents"]).total() / whole.total() for result in results)
    return {"messages": round(shares, 3), "files": round(mean(not result["error"] for result in results), 2)}


def main() -> None:
    """Print the figures as JSON."""
    seconds, count = float(os.environ.get("SECONDS", "20")), int(os.environ.get("DAMAGED", "60"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = files.whole(folder, seconds)
        for container, ways in WAYS.items():
            for way in ways:
                runs = [read_apart(container, way, made[container]) for _ in range(3)]
                marks: dict[str, list[dict[str, Any]]] = {"cut": [], "noise": []}
                for kind, broken in files.damaged(made[container], folder, count):
                    marks[kind].append(read_apart(container, way, broken))
                line = {
                    "container": container,
                    "way": way,
                    "MB": round(made[container].stat().st_size / 1e6, 1),
                    "cpu_s": median(run["cpu_s"] for run in runs),
                    "peak_MB": runs[0]["peak_MB"],
                }
                shares = {kind: saved(runs[0]["contents"], results) for kind, results in marks.items()}
                print(json.dumps(line | shares), flush=True)
        for container, what, path in files.bombs(made, folder):
            for way in WAYS[container]:
                result = read_apart(container, way, path)
                figures = {key: result[key] for key in ("cpu_s", "peak_MB", "error")}
                print(json.dumps({"bomb": what, "way": way, **figures}), flush=True)


if __name__ == "__main__":
    main()
