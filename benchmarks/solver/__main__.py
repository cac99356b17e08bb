"""`python -m benchmarks.solver`: one slot of 800 x 30 beside the bare evaluation of its individuals, and its peers.

Everything runs on one core, interleaved rig by rig, and is measured in processor seconds; figures are medians over
ROUNDS fresh rigs of 222 marks, the same for all. Ratios are per evaluation. Narrowed by MODELS, SEED and PEERS (names
of files in `peers`, or none).

`reached`: share of the rigs on which a run came within 1 % of the least mean distance, which SciPy finds from the
truth; `evaluations_to_target` and `seconds_to_target`: medians there, seconds in proportion to evaluations.
"""

import importlib
import json
import os
import secrets
import sys
from collections.abc import Sequence
from typing import Any

# One core for all threads of all libraries, before any of them starts one.
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

from benchmarks.accuracy.rigs import PAIRS, PLAIN, Rig, draw_rig  # noqa: E402
from benchmarks.solver.peers.contest import GENERATIONS, POPULATION, Contest, Peer, PeerMissingError  # noqa: E402
from benchmarks.solver.race import OURS, Time, race  # noqa: E402
from benchmarks.solver.target import WITHIN, Optimum, evaluations_of_ours_to, evaluations_to, optimum  # noqa: E402
from workers.geometry.models import MODELS, ModelName, parse_model  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402

FAMILIES = (
    "pymoo_ga", "pygad_ga", "deap_ga", "pygmo_peers", "evosax_gas", "octave_ga", "scipy_de", "cmaes_peer",
)  # fmt: skip


def find_peers(names: Sequence[str]) -> tuple[list[Peer], list[str]]:
    """The peers of those files, and a sentence for each that cannot be raced."""
    peers: list[Peer] = []
    missing: list[str] = []
    for name in names:
        try:
            peers += importlib.import_module(f"benchmarks.solver.peers.{name}").PEERS
        except (ImportError, PeerMissingError) as error:
            missing.append(f"{name}: not raced ({error})")
    return peers, missing


def measure(model: ModelName, peers: Sequence[Peer], seed: int, rounds: int) -> dict[str, Any]:
    """The figures of one model over `rounds` fresh rigs."""
    rigs = [draw_rig(model, np.random.default_rng((seed, number, MODELS.index(model)))) for number in range(rounds)]
    contests = [_contest(rig, seed, number) for number, rig in enumerate(rigs)]
    # Once unmeasured: what is compiled or imported on a first call is nobody's speed.
    contests[0].loss(np.full(contests[0].genes, 0.5))
    quick = [peer for peer in peers if not peer.slow]
    for peer in quick:
        peer.run(contests[0])
    bare: list[float] = []
    times: list[dict[str, Time]] = []
    for number, contest in enumerate(contests):
        seconds, found = race(contest, quick if number else peers)
        bare.append(seconds)
        times.append(found)
        print(
            model,
            number,
            {name: (round(t.seconds, 4), round(t.loss, 3)) for name, t in found.items()},
            file=sys.stderr,
        )
    found = summary(bare, times, peers)
    reached = [_reached(rig, contest, quick) for rig, contest in zip(rigs, contests, strict=True)]
    for name, row in [(OURS, found), *((peer.name, found["peers"][peer.name]) for peer in quick)]:
        row |= _to_target([one[name] for _, one in reached], [t[name] for t in times])
    found["rms_of_polish_over_scipy"] = round(float(np.max([best.rms_of_polish for best, _ in reached])), 6)
    return found


def _contest(rig: Rig, seed: int, number: int) -> Contest:
    schedule = {"population": POPULATION, "generations": GENERATIONS}
    return Contest(rig.problem(seed=number, schedule=schedule, **PLAIN), seed + number)


def _reached(rig: Rig, contest: Contest, peers: Sequence[Peer]) -> tuple[Optimum, dict[str, int | None]]:
    """The optimum of a rig, and everyone's evaluations until within 1 % of it."""
    best = optimum(contest.problem, rig.truth)
    target_px = WITHIN * best.mean_px
    found = {peer.name: evaluations_to(target_px, contest, peer) for peer in peers}
    return best, found | {OURS: evaluations_of_ours_to(target_px, contest)}


def _to_target(evaluations: Sequence[int | None], times: Sequence[Time]) -> dict[str, Any]:
    """The share of rigs on which the target was reached, and there the medians of evaluations and seconds."""
    taken = [
        (count, one.seconds * count / one.evaluations) for count, one in zip(evaluations, times, strict=True) if count
    ]
    median = np.median(taken, axis=0) if taken else [None, None]
    return {
        "reached": round(len(taken) / len(evaluations), 2),
        "evaluations_to_target": (taken and int(median[0])) or None,
        "seconds_to_target": (taken and round(float(median[1]), 5)) or None,
    }


def summary(bare: Sequence[float], times: Sequence[dict[str, Time]], peers: Sequence[Peer]) -> dict[str, Any]:
    """Ratios, rates and the table of one model, medians over its rigs."""
    of = {name: [t[name] for t in times if name in t] for name in times[0]}
    each = {name: float(np.median([one.seconds / one.evaluations for one in found])) for name, found in of.items()}
    loss = {name: float(np.median([one.loss for one in found])) for name, found in of.items()}
    gas = [peer for peer in peers if peer.family.endswith(" ga")]

    def ratio(names: Sequence[str]) -> float | None:
        return round(min(each[name] for name in names) / each[OURS], 2) if names else None

    evaluations = times[0][OURS].evaluations
    slot = np.array([t[OURS].seconds for t in times])
    return {
        "ratio_to_bare_evaluation": round(float(np.median(slot / np.array(bare))), 3),
        "gprojections_per_s": round(PAIRS * evaluations / float(np.median(bare)) * 1e-9, 3),
        "ratio_vs_python_peers": ratio([peer.name for peer in gas if peer.family == "python ga"]),
        "ratio_vs_pygmo_sga": ratio([peer.name for peer in gas if peer.name == "pygmo sga"]),
        "ratio_vs_fastest_peer_ga": ratio([peer.name for peer in gas]),
        "loss": round(loss[OURS], 4),
        "lowest_loss_of_gas": all(loss[OURS] <= loss[peer.name] for peer in gas),
        "slot_ms": round(float(np.median(slot)) * 1e3, 2),
        "peers": {
            peer.name: {
                "seconds": round(float(np.median([one.seconds for one in of[peer.name]])), 4),
                "loss": round(loss[peer.name], 4),
                "evaluations": int(np.median([one.evaluations for one in of[peer.name]])),
                "family": peer.family,
                "settings": peer.settings,
            }
            for peer in peers
        },
    }


def main() -> None:
    rounds, seed = int(os.environ.get("ROUNDS", "5")), int(os.environ.get("SEED") or secrets.randbits(30))
    names = [name for name in os.environ.get("PEERS", ",".join(FAMILIES)).split(",") if name and name != "none"]
    peers, missing = find_peers(names)
    for sentence in missing:
        print(sentence, file=sys.stderr)
    warm_up()
    result = {
        name: measure(parse_model(name), peers, seed, rounds)
        for name in os.environ.get("MODELS", ",".join(MODELS)).split(",")
    }
    print(json.dumps({"rounds": rounds, "seed": seed, "missing": missing, **result}))


if __name__ == "__main__":
    main()
