"""`python -m benchmarks.clock_offset`: how well the clocks' offset is found from a walk, and whether it says so.

Simulated: a VLP-16, a camera of 16 unknown parameters on a mount that is known to a few degrees, offsets of -60 to
+60 ms, marks of 1 px on the frames that were paired without knowing the offset. Cases: a minute of the walk that we
advise; with 5 % of blunders among its marks; its first 20 seconds; a minute from anywhere to anywhere in the field;
slowly; standing still. WALKS: walks of each kind (default 12); SEED: of the first (default fresh); ONLY: names of
walks, comma between. The keys at the top of the answer are those of `refined` and a minute of the advised walk.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Final

# Two processes share the cores; BLAS with threads of its own would fight over them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from apexcal.documents.detectors import DETECTORS
from benchmarks.clock_offset.walks import Case, Found, Scenario, run

SCENARIOS: Final = (
    Scenario(
        "rows",
        60.0,
        (
            Case("minute", 60.0, detectors=tuple(DETECTORS)),
            Case("blunders", 60.0, blunders=0.05),
            Case("twenty_seconds", 20.0),
        ),
    ),
    Scenario("field", 60.0, (Case("anywhere", 60.0),)),
    Scenario("slow", 60.0, (Case("slow", 60.0),)),
    Scenario("still", 20.0, (Case("still", 20.0),)),
)


def main() -> None:
    """Run every case and print tables to stderr, one line of JSON to stdout."""
    walks = int(os.environ.get("WALKS", "12"))
    first = int(os.environ.get("SEED") or secrets.randbelow(10**9))
    wanted = os.environ.get("ONLY", "")
    scenarios = [one for one in SCENARIOS if not wanted or one.walk in wanted.split(",")]
    print(f"first seed {first}, {walks} walks of each kind", file=sys.stderr)
    with ProcessPoolExecutor(max_workers=min(2, os.cpu_count() or 1)) as pool:
        pending = [pool.submit(run, one, first + number) for number in range(walks) for one in scenarios]
        found = [one for future in pending for one in future.result()]
    table = {
        case.name: {name: summary(_of(found, case.name, name)) for name in case.detectors}
        for one in scenarios
        for case in one.cases
    }
    _print(table)
    headline = table.get("minute", {}).get("refined", {})
    print(json.dumps({"bench": "clock_offset", "seed": first, "walks": walks, **headline, "cases": table}))


def _of(found: list[Found], case: str, detector: str) -> list[Found]:
    return [one for one in found if (one.case, one.detector) == (case, detector)]


def summary(found: list[Found]) -> dict[str, Any]:
    """RMS error, bias and stated standard deviation in ms; errors in units of what was stated; what was refused."""
    answered = [one for one in found if one.offset_ms is not None and one.sigma_ms is not None]
    refused = 1.0 - len(answered) / max(len(found), 1)
    marks = float(np.mean([one.marks for one in found])) if found else 0.0
    if not answered:
        return {"rms_ms": None, "refused_share": refused, "marks": round(marks, 1)}
    error = np.array([(one.offset_ms or 0.0) - one.true_ms for one in answered])
    sigma = np.array([one.sigma_ms or 0.0 for one in answered])
    scored = error / sigma
    return {
        "rms_ms": round(float(np.sqrt(np.mean(error**2))), 3),
        "bias_ms": round(float(np.mean(error)), 3),
        "worst_ms": round(float(np.max(np.abs(error))), 3),
        "sigma_ms": round(float(np.mean(sigma)), 3),
        "normalised_rms": round(float(np.sqrt(np.mean(scored**2))), 3),
        "coverage_2sigma": round(float(np.mean(np.abs(scored) < 2.0)), 3),
        "refused_share": round(refused, 3),
        "marks": round(marks, 1),
    }


def _print(table: dict[str, dict[str, dict[str, Any]]]) -> None:
    columns = ("rms_ms", "bias_ms", "sigma_ms", "normalised_rms", "coverage_2sigma", "refused_share", "marks")
    print(f"{'case':16}{'detector':10}" + "".join(f"{name:>17}" for name in columns), file=sys.stderr)
    for case, of_case in table.items():
        for detector, figures in of_case.items():
            cells = "".join(f"{figures.get(name) if figures.get(name) is not None else '-':>17}" for name in columns)
            print(f"{case:16}{detector:10}{cells}", file=sys.stderr)


if __name__ == "__main__":
    main()
