"""`python -m benchmarks.paper`: the paper's experiment, simulated, with its error budget.

Two walks all over a field of 10 x 30 m with a board of 2 x 3 feet before a VLP-16 and a camera at 15 Hz that looks 15
degrees down, whose clock shows 30 ms more: 222 pairs to train, 358 to test, clicks of 1 px. Each detector's pairs
are fitted by the house's solver. Every source of error is switched off in turn; what it adds is the difference of
the squares. `refined+clock` moves the refined vertices to the frames' times, at the offset that was estimated from
the training marks. `truth_*`: mean distance between the fitted projection and the true one of vertices all over the
field. REPEATS: draws of clicks and of the camera's phase (default 6); RIGS: walks and mounts (default 2); SEED: of
the first (default fresh); SHORT=1: half of the pairs, one walk and one draw.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Final

# Two processes share the cores; BLAS with threads of its own would fight over them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.paper.budget import MODELS, SOURCES, WAYS, Score, score
from benchmarks.paper.recordings import Walked, Wanted, walk_and_detect

# What the paper reports, px: mean over its 222 training pairs and over its 358 held-out pairs.
PAPER: Final = {"pinhole": (6.35, 6.75), "brown_conrady": (5.02, 5.10)}
# The mean length of an error of 1 px in u and in v: no camera has less on clicked pairs.
FLOOR_PX: Final = float(np.sqrt(np.pi / 2.0))


def main() -> None:
    """Run everything and print tables to stderr, one line of JSON to stdout."""
    began = time.perf_counter()
    short = bool(os.environ.get("SHORT"))
    rigs = int(os.environ.get("RIGS", "1" if short else "2"))
    repeats = int(os.environ.get("REPEATS", "1" if short else "6"))
    first = int(os.environ.get("SEED") or secrets.randbelow(10**9))
    with ProcessPoolExecutor(max_workers=min(2, os.cpu_count() or 1)) as pool:
        wanted = [one for rig in range(rigs) for one in _wanted(first + 2 * rig, short)]
        walked = list(pool.map(walk_and_detect, wanted))
        pending = [
            pool.submit(score, walked[2 * rig], walked[2 * rig + 1], way, model, repeat)
            for rig in range(rigs)
            for repeat in range(repeats)
            for way in WAYS
            for model in MODELS
        ]
        scores = [future.result() for future in pending]
    print(json.dumps(_answer(walked, scores, first, repeats, time.perf_counter() - began)))


def _wanted(seed: int, short: bool) -> tuple[Wanted, Wanted]:
    """The training and the test recording: as many sweeps as in the paper, and a walk that goes on for the rules."""
    if short:
        return Wanted("train", seed, 120, 2177, 8000), Wanted("test", seed + 1, 120, 1500, 8000)
    return Wanted("train", seed, 222, 7639, 16000), Wanted("test", seed + 1, 358, 2177, 24000)


def _answer(walked: list[Walked], scores: list[Score], seed: int, repeats: int, seconds: float) -> dict[str, Any]:
    print(f"seed {seed}: {len(walked) // 2} rigs, {repeats} draws each\n", file=sys.stderr)
    _print_found(walked)
    table = {way: {model: _summary(scores, way, model) for model in MODELS} for way in WAYS}
    _print_budget(table)
    lens = {way: table[way]["brown_conrady"] for way in WAYS}
    offsets = np.array([one.offset_ms - 30.0 for one in scores if one.way == "refined+clock"])
    strict, refined = lens["strict"]["truth_px"], lens["refined+clock"]["truth_px"]
    print(
        f"\nerror against the truth over the field: strict {strict:.3f} px, refined+clock {refined:.3f} px; clicks "
        f"alone leave {FLOOR_PX:.2f} px on held-out pairs",
        file=sys.stderr,
    )
    return {
        "bench": "paper",
        "seed": seed,
        "rigs": len(walked) // 2,
        "repeats": repeats,
        "truth_strict_px": strict,
        "truth_tolerant_px": lens["tolerant"]["truth_px"],
        "truth_refined_px": refined,
        "truth_refined_over_strict": round(refined / strict, 3),
        "heldout_strict_px": lens["strict"]["heldout_px"],
        "heldout_tolerant_px": lens["tolerant"]["heldout_px"],
        "heldout_refined_px": lens["refined+clock"]["heldout_px"],
        "heldout_floor_px": round(FLOOR_PX, 3),
        "offset_rms_ms": round(float(np.sqrt(np.mean(offsets**2))), 3),
        "paper_px": {model: {"train": train, "heldout": held} for model, (train, held) in PAPER.items()},
        "budget": table,
        "seconds": round(seconds, 1),
    }


def _summary(scores: list[Score], way: str, model: str) -> dict[str, Any]:
    """Means over rigs and draws; `adds_px` is the RMS that each source adds on held-out pairs, and to the truth."""
    chosen = [one for one in scores if (one.way, one.model) == (way, model)]
    means = {
        source: {
            key: float(np.mean([one.figures[source][key] for one in chosen])) for key in chosen[0].figures[source]
        }
        for source in chosen[0].figures
    }
    whole = means["all"]
    adds = {
        source: {
            key: round(_difference(whole[f"{key}_rms_px"], without[f"{key}_rms_px"]), 3)
            for key in ("heldout", "truth")
        }
        for source, without in means.items()
        if source != "all"
    }
    rounded = {key: round(value, 3) for key, value in whole.items()}
    return {**rounded, "pairs": chosen[0].pairs, "adds_px": adds}


def _difference(whole: float, part: float) -> float:
    """What is missing to the whole, in squares; negative where leaving it out made things worse."""
    return float(np.sign(whole - part) * np.sqrt(abs(whole**2 - part**2)))


def _print_found(walked: list[Walked]) -> None:
    for name in ("train", "test"):
        of = [one for one in walked if one.wanted.name == name]
        for detector in of[0].vertices:
            share = np.mean([len(one.vertices[detector]) / one.sweeps[detector] for one in of])
            print(f"{name:6}{detector:10}{share:7.1%} of the sweeps give a vertex", file=sys.stderr)


def _print_budget(table: dict[str, dict[str, dict[str, Any]]]) -> None:
    columns = "".join(f"{source:>10}" for source in SOURCES)
    print(
        f"\n{'':32}{'train':>8}{'held out':>10}{'truth':>8}   what each adds on held-out pairs, RMS px\n"
        f"{'':32}{'mean px':>8}{'mean px':>10}{'mean px':>8}{columns}",
        file=sys.stderr,
    )
    for model in MODELS:
        train, held = PAPER[model]
        print(f"{'the paper':16}{model:16}{train:8.2f}{held:10.2f}", file=sys.stderr)
        for way, models in table.items():
            one = models[model]
            adds = "".join(f"{one['adds_px'].get(source, {}).get('heldout', 0.0):10.2f}" for source in SOURCES)
            print(
                f"{way:16}{model:16}{one['train_px']:8.2f}{one['heldout_px']:10.2f}{one['truth_px']:8.2f}{adds}",
                file=sys.stderr,
            )


if __name__ == "__main__":
    main()
