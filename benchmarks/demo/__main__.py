"""``make demo``: exit code 0 only if every step happened and its figures reach the demo's goals."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from apexcal.client import ClientError
from apexcal.embedded.folder import DEFAULT
from apexcal.embedded.serving import LocalService, serving
from apexcal.transport import Document
from benchmarks.demo import real, report, simulated
from benchmarks.demo.steps import DemoSession, DemoSteps

REPORT = Path("var/demo/report.json")
_WHAT = (
    "Drive the whole service with a simulated recording and, where they are, with real ones: from upload to "
    f"calibration, in a few minutes. It keeps its data in {DEFAULT} and writes {REPORT}, below the current folder. "
    "Exit code 1 where a step failed or a result fell short."
)


def main() -> int:
    """Run both halves at once and say how it went. 0: done; 1: something failed or fell short."""
    argparse.ArgumentParser(prog="python -m benchmarks.demo", description=_WHAT).parse_args()
    out = Console(highlight=False)
    began = time.monotonic()
    try:
        done = _drive(out)
    except ClientError as error:
        Console(stderr=True, highlight=False).print(f"[bold red]demo:[/] {escape(error.sentence)}", soft_wrap=True)
        return 1
    except KeyboardInterrupt:
        return 130
    report.write(done, REPORT)
    report.show(done, out)
    missed = report.shortfalls(done)
    for sentence in missed:
        out.print(f"[bold red]short:[/] {escape(sentence)}")
    out.print(f"\nThe report is in {REPORT}. It took {time.monotonic() - began:.0f} s.")
    out.print("Look at it in a browser: [bold]make serve[/], and open the link that it prints.")
    return 1 if missed else 0


def _drive(out: Console) -> Document:
    """Simulate while the service starts, then drive both halves through its API."""
    scratch = Path(tempfile.mkdtemp(prefix="simulated-", dir=_folder(REPORT.parent)))
    data = real.find_data(Path.cwd())
    try:
        with DemoSteps(out) as steps, ThreadPoolExecutor(2) as pool:
            simulating = pool.submit(simulated.simulate, steps, scratch / "walk")
            with _started(steps) as service:
                session = DemoSession(steps, "simulated", service.url, service.token)
                fleet = session.client.fleets.create(f"Demo {datetime.now(UTC):%Y-%m-%d %H:%M:%S}")
                beside = data and pool.submit(
                    real.run, DemoSession(steps, "real", service.url, service.token), fleet, data, scratch
                )
                simulating.result()
                first = simulated.run(session, fleet, scratch / "walk", REPORT.parent / "truck.calibrated.urdf")
                skipped = {"skipped": "a clone holds no real recording (../shared/data/vlp16-diamond-board)"}
                return {"simulated": first, "real": beside.result() if beside else skipped}
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def _started(steps: DemoSteps) -> Iterator[LocalService]:
    with ExitStack() as until:
        with steps.step("service", "start") as on_progress:
            on_progress(0.0, f"embedded, on {DEFAULT}")
            service = until.enter_context(serving(DEFAULT.resolve()))
            on_progress(1.0, service.url)
        yield service


def _folder(path: Path) -> Path:
    path.mkdir(parents=True, exist_ok=True)
    return path


if __name__ == "__main__":
    sys.exit(main())
