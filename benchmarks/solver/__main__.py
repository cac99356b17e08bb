"""`python -m benchmarks.solver`: one slot of 800 x 30 beside the bare evaluation of its individuals, and two peers.

Everything runs on one core and is measured in processor seconds; figures are medians over ROUNDS fresh rigs of 222
marks, the same for all. `times_ours` is per evaluation. Narrowed by MODELS, SEED and PEERS (pygad, cmaes, or none).

`reached`: share of the rigs on which a search came within 1 % of the least mean distance, which SciPy finds from the
truth; `evaluations_to_target`: the median there.
"""

import json
import os
import secrets
import sys
import time
from collections.abc import Sequence
from typing import Any

# One core for all threads of all libraries, before any of them starts one.
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

from benchmarks.accuracy.rigs import PAIRS, PLAIN, draw_rig  # noqa: E402
from benchmarks.solver.bare_evaluation import SlotTimes, time_slot  # noqa: E402
from benchmarks.solver.contest import GENERATIONS, POPULATION, Contest, Peer  # noqa: E402
from benchmarks.solver.target import WITHIN, evaluations_of_slot_to, optimum  # noqa: E402
from workers.geometry.models import DEFAULT_MODELS as MODELS  # noqa: E402
from workers.geometry.models import ModelName, parse_model  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402


def measure(model: ModelName, peers: Sequence[Peer], seed: int, rounds: int) -> dict[str, Any]:
    """The figures of one model over `rounds` fresh rigs."""
    rigs = [draw_rig(model, np.random.default_rng((seed, number, MODELS.index(model)))) for number in range(rounds)]
    schedule = {"population": POPULATION, "generations": GENERATIONS}
    problems = [rig.problem(seed=number, schedule=schedule, **PLAIN) for number, rig in enumerate(rigs)]
    best = [optimum(problem, rig.truth) for problem, rig in zip(problems, rigs, strict=True)]
    targets = [WITHIN * one.mean_px for one in best]
    times = [time_slot(Contest(problem, seed)) for problem in problems]
    counts = [evaluations_of_slot_to(target, problem) for target, problem in zip(targets, problems, strict=True)]
    slot_s, bare_s, loss, evaluations = (float(np.median(column)) for column in zip(*times, strict=True))
    return {
        "ratio_to_bare_evaluation": round(float(np.median([one.slot_s / one.bare_s for one in times])), 3),
        "gprojections_per_s": round(PAIRS * evaluations / bare_s * 1e-9, 3),
        "slot_ms": round(slot_s * 1e3, 2),
        "loss": round(loss, 4),
        **_to_target(counts),
        "rms_of_polish_over_scipy": round(max(one.rms_of_polish for one in best), 6),
        "peers": {
            peer.name: _race(peer, [Contest(problem, seed + n) for n, problem in enumerate(problems)], targets, times)
            for peer in peers
        },
    }


def _race(
    peer: Peer, contests: Sequence[Contest], targets: Sequence[float], ours: Sequence[SlotTimes]
) -> dict[str, Any]:
    # Once unmeasured: what is compiled or imported on a first call is nobody's speed.
    peer.run(Contest(contests[0].problem, 0))
    seconds, losses = list[float](), list[float]()
    for contest in contests:
        began = time.process_time()
        best = peer.run(contest)
        seconds.append(time.process_time() - began)
        losses.append(contest.judge(best))
        print(peer.name, round(seconds[-1], 4), round(losses[-1], 3), file=sys.stderr)
    each = np.array(seconds) / [contest.evaluations for contest in contests]
    return {
        "times_ours": round(float(np.median(each / [one.slot_s / one.evaluations for one in ours])), 2),
        "seconds": round(float(np.median(seconds)), 4),
        "loss": round(float(np.median(losses)), 4),
        "evaluations": int(np.median([contest.evaluations for contest in contests])),
        "settings": peer.settings,
        **_to_target([one.evaluations_to(target) for one, target in zip(contests, targets, strict=True)]),
    }


def _to_target(evaluations: Sequence[int | None]) -> dict[str, Any]:
    counts = [count for count in evaluations if count]
    median = int(np.median(counts)) if counts else None
    return {"reached": round(len(counts) / len(evaluations), 2), "evaluations_to_target": median}


def main() -> None:
    """Print one line of JSON."""
    rounds, seed = int(os.environ.get("ROUNDS", "5")), int(os.environ.get("SEED") or secrets.randbits(30))
    names = [name for name in os.environ.get("PEERS", "pygad,cmaes").split(",") if name not in ("", "none")]
    peers: list[Peer] = []
    if names:
        from benchmarks.solver.peers import PEERS  # only they need the libraries

        peers = [PEERS[name] for name in names]
    warm_up()
    result = {
        name: measure(parse_model(name), peers, seed, rounds)
        for name in os.environ.get("MODELS", ",".join(MODELS)).split(",")
    }
    print(json.dumps({"rounds": rounds, "seed": seed, **result}))


if __name__ == "__main__":
    main()
