"""`python -m benchmarks.real`: every recording of ../shared/data with a board, as a stranger runs `apexcal solve`.

As a folder and as a bag, with its published lens stated and without, with the board's size stated and open. A table
says what became of each: vertices, marks against published pixels, verdict, file, and how far the mount lies from the
one that fits the published corners under the published lens. Nothing of the product was chosen by these figures.
ONLY= takes parts of runs' names, with commas between.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from apexcal.client import Client
from apexcal.embedded.serving import LocalService, serving
from benchmarks.detection.real import DATA, RECORDINGS
from benchmarks.real.forms import LENS_OF, LOOKS, Case, cases, write
from benchmarks.real.scores import Outcome, outcome


def main() -> None:
    for name in LENS_OF:
        if not (DATA / name).exists():
            print(f"{name} is absent: it is looked for in ../shared/data")
    print("infrared-level-board: not run, because of its four poses the machine marks none", flush=True)
    parts = os.environ.get("ONLY", "").split(",")
    chosen = [case for case in cases() if any(part in case.title for part in parts)]
    with TemporaryDirectory() as scratch, serving(Path(scratch) / "data") as service:
        for case in chosen:
            print(_solve(case, service, Path(scratch)).line, flush=True)


def _solve(case: Case, service: LocalService, folder: Path) -> Outcome:
    """Run the command on a recording written for it."""
    poses, path, out = RECORDINGS[case.recording], write(case, folder), folder / f"{case.title}.urdf"
    looks = f"{'images' if case.form == 'folder' else 'front'}={LOOKS[case.recording]}"
    words = ["solve", str(path), "-o", str(out), "--still", "--looks", looks, "--machine-marks", "--json"]
    words += ["--board", f"{poses.width_m}x{poses.height_m}"] if case.size else []
    words += ["--rings", str(poses.rings)] if poses.rings and case.form == "folder" else []
    words += ["--url", service.url, "--token", service.token, "--fleet", "Bench"]
    began = time.monotonic()
    done = subprocess.run([sys.executable, "-m", "apexcal.cli", *words], capture_output=True, text=True)
    document = json.loads(done.stdout) if done.stdout.lstrip().startswith("{") else None
    with Client(service.url, service.token) as client:
        return outcome(case, client, document, done.stderr, is_written=out.exists(), seconds=time.monotonic() - began)


if __name__ == "__main__":
    main()
