"""`python -m benchmarks.startup`: seconds until `apexcal serve` answers, and what imports cost.

First start: an empty data folder and no compiled kernels. Second start: the same folder and kernels again. Figures
are medians of ROUNDS; seconds depend on what else the machine does, processor seconds hardly. Linux only: it reads
/proc.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from statistics import median

from benchmarks.house import cpu_s

MODULES = ("service.app", "workers.app", "workers.tasks.entry", "workers.sweeper", "apexcal.cli")
_PATIENCE_S = 600.0  # compiling takes a minute of processor time, on a busy machine many more

Figures = dict[str, float]


def import_s(module: str) -> float:
    """Processor seconds of a process that imports the module and ends."""
    with subprocess.Popen((sys.executable, "-c", f"import {module}")) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(f"{module} cannot be imported")
    return used.ru_utime + used.ru_stime


def start(data: Path, kernels: Path) -> Figures:
    """Start the service, wait until it answers and until its workers are warm, and stop it."""
    began = time.monotonic()
    process = subprocess.Popen(
        (sys.executable, "-m", "apexcal.cli", "serve", "--data", str(data), "--port", "0", "--json"),
        env={**os.environ, "NUMBA_CACHE_DIR": str(kernels)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        answers_s, processor_s = time.monotonic() - began, cpu_s(process.pid)
        _wait_until_warm(json.loads(said)["url"], began + _PATIENCE_S)
        return {"answers_s": answers_s, "processor_s": processor_s, "warm_s": time.monotonic() - began}
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


def _wait_until_warm(url: str, deadline: float) -> None:
    while time.monotonic() < deadline:
        with urllib.request.urlopen(f"{url}/readyz", timeout=10) as answer:
            if json.load(answer)["parts"]["workers"]["ok"]:
                return
        time.sleep(0.1)
    raise TimeoutError(f"no warm worker within {_PATIENCE_S:.0f} s")


def _medians(rounds: list[Figures]) -> Figures:
    return {name: round(median(one[name] for one in rounds), 2) for name in rounds[0]}


def main() -> None:
    """Print one line of JSON."""
    rounds = int(os.environ.get("ROUNDS", "3"))
    # One round more: the first reads the files from the disk.
    imports = [{module: import_s(module) for module in MODULES} for _ in range(rounds + 1)][1:]
    starts: dict[str, list[Figures]] = {"first_start": [], "second_start": []}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            for figures in starts.values():
                figures.append(start(Path(folder) / "data", Path(folder) / "kernels"))
    medians = {which: _medians(figures) for which, figures in starts.items()}
    print(json.dumps({"rounds": rounds, "import_processor_s": _medians(imports), **medians}))


if __name__ == "__main__":
    main()
