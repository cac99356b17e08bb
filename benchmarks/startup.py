"""`python -m benchmarks.startup`: seconds until `apexcal serve` answers, and what imports cost.

First start: an empty data folder and no compiled kernels. Second start: the same folder and kernels again. BESIDE
names another checkout, set up by `make setup frontend`, that is measured in turn with this one. The figures are
medians of ROUNDS; seconds depend on what else the machine does, processor seconds hardly. Linux only: it reads /proc.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

MODULES = ("service.app", "workers.app", "workers.tasks.entry", "workers.sweeper", "apexcal.cli")
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_PATIENCE_S = 120.0

Figures = dict[str, float]


def import_s(checkout: Path, module: str) -> float:
    """Processor seconds of a process that imports the module and ends."""
    with subprocess.Popen((_python(checkout), "-c", f"import {module}"), cwd=checkout) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(f"{module} of {checkout} cannot be imported")
    return used.ru_utime + used.ru_stime


def start(checkout: Path, data: Path, kernels: Path) -> Figures:
    """Start the service, wait until it answers and until its workers are warm, and stop it."""
    began = time.monotonic()
    process = subprocess.Popen(
        (_python(checkout), "-m", "apexcal.cli", "serve", "--data", str(data), "--port", "0", "--json"),
        cwd=checkout,
        env={**os.environ, "NUMBA_CACHE_DIR": str(kernels)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        answers_s, processor_s = time.monotonic() - began, tree_s(process.pid)
        _wait_until_warm(json.loads(said)["url"], began + _PATIENCE_S)
        return {"answers_s": answers_s, "processor_s": processor_s, "warm_s": time.monotonic() - began}
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


def tree_s(root: int) -> float:
    """Processor seconds so far of a process and of everything that it started."""
    used: dict[int, tuple[int, int]] = dict(_processes())
    inside = {root}
    while grown := {pid for pid, (parent, _) in used.items() if parent in inside} - inside:
        inside |= grown
    return sum(used[pid][1] for pid in inside if pid in used) / _TICKS_PER_S


def _processes() -> Iterator[tuple[int, tuple[int, int]]]:
    """Each process's id, its parent's, and its ticks: its own, and those of the children that it waited for."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        # proc_pid_stat(5): fields 4 (ppid) and 14 to 17 (utime, stime, cutime, cstime); field 3 is the first here.
        yield int(folder.name), (int(fields[1]), sum(map(int, fields[11:15])))


def _wait_until_warm(url: str, deadline: float) -> None:
    while time.monotonic() < deadline:
        with urllib.request.urlopen(f"{url}/readyz", timeout=10) as answer:
            if json.load(answer)["parts"]["workers"]["ok"]:
                return
        time.sleep(0.1)
    raise TimeoutError(f"no warm worker within {_PATIENCE_S:.0f} s")


def _python(checkout: Path) -> str:
    own = checkout / ".venv/bin/python"
    return str(own) if own.exists() else sys.executable


def _starts(checkout: Path) -> dict[str, Figures]:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        return {which: start(checkout, place / "data", place / "kernels") for which in ("first", "second")}


def _medians(rounds: list[Figures]) -> Figures:
    return {name: round(median(one[name] for one in rounds), 2) for name in rounds[0]}


def main() -> None:
    """Print one line of JSON."""
    rounds = int(os.environ.get("ROUNDS", "3"))
    checkouts = {"this": Path.cwd()}
    if beside := os.environ.get("BESIDE"):
        checkouts["beside"] = Path(beside).resolve()
    imports: dict[str, list[Figures]] = {name: [] for name in checkouts}
    starts: dict[str, list[dict[str, Figures]]] = {name: [] for name in checkouts}
    # One round more: the first reads the files from the disk.
    for number in range(rounds + 1):
        for name, checkout in checkouts.items():
            used = {module: import_s(checkout, module) for module in MODULES}
            if number:
                imports[name].append(used)
    for _ in range(rounds):
        for name, checkout in checkouts.items():
            starts[name].append(_starts(checkout))
    document: dict[str, Any] = {
        name: {
            "import_processor_s": _medians(imports[name]),
            **{f"{which}_start": _medians([one[which] for one in starts[name]]) for which in ("first", "second")},
        }
        for name in checkouts
    }
    print(json.dumps({"rounds": rounds, **document}))


if __name__ == "__main__":
    main()
