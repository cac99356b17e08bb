"""`python -m benchmarks.solver`: one slot of 800 x 30 beside the bare evaluation of its individuals, and two peers.

Everything runs on one core and is measured in processor seconds; figures are medians over ROUNDS (5) fresh rigs of
222 marks, the same for all. PEERS=none leaves the peers out.
"""

import json
import os
import secrets
import time
from typing import Any

# One core for all threads of all libraries, before any of them starts one.
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

from benchmarks.accuracy.rigs import PLAIN, algorithm_2, draw_rig  # noqa: E402
from benchmarks.solver.contest import GENERATIONS, POPULATION, Contest, time_slot  # noqa: E402
from workers.geometry.models import DEFAULT_MODELS as MODELS  # noqa: E402
from workers.geometry.models import ModelName  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402


def measure(model: ModelName, peers: dict[str, Any], seed: int, rounds: int) -> dict[str, Any]:
    """The figures of one model over `rounds` fresh rigs."""
    schedule = {"population": POPULATION, "generations": GENERATIONS}
    contests: list[Contest] = []
    for number in range(rounds):
        rig = draw_rig(model, np.random.default_rng((seed, number, MODELS.index(model))))
        contests.append(Contest(algorithm_2(rig.problem(seed=number, schedule=schedule, **PLAIN)), seed + number))
    times = [time_slot(contest) for contest in contests]
    slot_s, _, loss = (float(np.median(column)) for column in zip(*times, strict=True))
    return {
        "ratio_to_bare_evaluation": round(float(np.median([one.slot_s / one.bare_s for one in times])), 3),
        "slot_ms": round(slot_s * 1e3, 2),
        "loss": round(loss, 4),
        "peers": {name: _race(search, contests) for name, search in peers.items()},
    }


def _race(search: Any, contests: list[Contest]) -> dict[str, float]:
    # Once unmeasured: what is compiled or imported on a first call is nobody's speed.
    search(contests[0])
    rows: list[tuple[float, float]] = []
    for contest in contests:
        began = time.process_time()
        best = search(contest)
        rows.append((1e3 * (time.process_time() - began), contest.judge(best)))
    ms, loss = np.median(rows, axis=0)
    return {"ms": round(float(ms), 2), "loss": round(float(loss), 4)}


def main() -> None:
    """Print one line of JSON."""
    rounds, seed = int(os.environ.get("ROUNDS", "5")), int(os.environ.get("SEED") or secrets.randbits(30))
    peers: dict[str, Any] = {}
    if os.environ.get("PEERS") != "none":
        from benchmarks.solver.peers import PEERS  # only they need the libraries

        peers = PEERS
    warm_up()
    print(
        json.dumps({"rounds": rounds, "seed": seed, **{name: measure(name, peers, seed, rounds) for name in MODELS}})
    )


if __name__ == "__main__":
    main()
