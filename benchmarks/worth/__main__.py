"""`python -m benchmarks.worth`: success against what makes a calibration hard, as one line of JSON.

RIGS (default 24) fresh rigs a point, shared among the camera models; QUESTIONS narrows, SEED repeats a run. Seconds
are processor seconds of one core. Progress goes to stderr.
"""

import json
import os
import secrets
import sys
import time
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from benchmarks.worth.methods import RIGHT_PX  # noqa: E402
from benchmarks.worth.questions import QUESTIONS, Place, answer  # noqa: E402
from benchmarks.worth.summary import curve  # noqa: E402
from workers.geometry.models import DEFAULT_MODELS as MODELS  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402


def main() -> None:
    rigs, seed = int(os.environ.get("RIGS", "24")), int(os.environ.get("SEED") or secrets.randbits(31))
    names = os.environ.get("QUESTIONS", ",".join(QUESTIONS)).split(",")
    unknown = [name for name in names if name not in QUESTIONS]
    if unknown:
        sys.exit(f"There is no question {', '.join(unknown)}; QUESTIONS are of {', '.join(QUESTIONS)}")
    if rigs < len(MODELS):
        sys.exit(f"RIGS is {rigs}; each point needs {len(MODELS)} or more, one for each camera model")
    began = time.perf_counter()
    warm_up()
    asked = [(name, at, n) for name in names for at in range(len(QUESTIONS[name].values)) for n in range(rigs)]
    told = _ask(asked, seed)
    curves: dict[str, Any] = {}
    for name in names:
        question = QUESTIONS[name]
        points = [[told[name, at, n] for n in range(rigs)] for at in range(len(question.values))]
        curves[name] = curve(question, points)
    seconds = round(time.perf_counter() - began, 1)
    result = {"rigs": rigs, "seed": seed, "right_px": RIGHT_PX, "curves": curves}
    print(json.dumps(result | {"seconds": seconds}))


def _ask(asked: list[Place], seed: int) -> dict[Place, dict[str, Any]]:
    told: dict[Place, dict[str, Any]] = {}
    open_rigs: dict[str, int] = defaultdict(int)
    for name, *_ in asked:
        open_rigs[name] += 1
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), warm_up) as pool:
        waiting = {pool.submit(answer, place, seed): place for place in asked}
        for done in as_completed(waiting):
            place = waiting[done]
            told[place] = done.result()
            open_rigs[place[0]] -= 1
            if not open_rigs[place[0]]:
                print(f"{place[0]} done, {len(told)} of {len(asked)} rigs", file=sys.stderr, flush=True)
    return told


if __name__ == "__main__":
    main()
