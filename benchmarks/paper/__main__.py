"""`python -m benchmarks.paper`: the paper's experiment, simulated, beside the errors that it reports.

Two walks all over a field of 10 x 30 m with a board of 2 x 3 feet before a VLP-16 and a camera at 15 Hz that looks 15
degrees down, whose clock shows 30 ms more: 222 pairs to train, 358 to test, clicks of 1 px. Each detector's pairs are
fitted by the house's solver. `refined+clock` moves the refined vertices to the frames' times, at the offset that was
estimated from the training marks. `truth_px`: mean distance between the fitted projection and the true one of
vertices all over the field. REPEATS: draws of clicks and of the camera's phase (default 6); RIGS: walks and mounts
(default 2); SEED: of the first (default fresh); SHORT=1: half of the pairs, one walk and one draw.
"""

from __future__ import annotations

import json
import os
import secrets
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Final

# Two processes share the cores; BLAS with threads of its own would fight over them.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.paper.recordings import Walked, Wanted, walk_and_detect
from benchmarks.paper.scores import MODELS, WAYS, Score, score

# What the paper reports, px: mean over its 222 training pairs and over its 358 held-out pairs.
PAPER: Final = {"pinhole": (6.35, 6.75), "brown_conrady": (5.02, 5.10)}
# The mean length of an error of 1 px in u and in v: no camera has less on clicked pairs.
FLOOR_PX: Final = float(np.sqrt(np.pi / 2.0))


_ERRORS: Final = ("train_px", "heldout_px", "truth_px")


def main() -> None:
    """Run everything and print one line of JSON."""
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
    rigs = len(walked) // 2
    table = {way: {model: _means(scores, way, model) for model in MODELS} for way in WAYS}
    lens = {way: table[way]["brown_conrady"] for way in WAYS}
    offsets = np.array([one.offset_ms - 30.0 for one in scores if one.way == "refined+clock"])
    return {
        "bench": "paper",
        "seed": seed,
        "rigs": rigs,
        "repeats": repeats,
        "truth_refined_over_strict": round(lens["refined+clock"]["truth_px"] / lens["strict"]["truth_px"], 3),
        "heldout_refined_px": lens["refined+clock"]["heldout_px"],
        "heldout_floor_px": round(FLOOR_PX, 3),
        "offset_rms_ms": round(float(np.sqrt(np.mean(offsets**2))), 3),
        "paper_px": {model: {"train": train, "heldout": heldout} for model, (train, heldout) in PAPER.items()},
        "table": table,
        "seconds": round(seconds, 1),
    }


def _means(scores: list[Score], way: str, model: str) -> dict[str, float]:
    """Over rigs and draws."""
    rows = [one for one in scores if (one.way, one.model) == (way, model)]
    return {key: round(float(np.mean([getattr(one, key) for one in rows])), 3) for key in _ERRORS}


if __name__ == "__main__":
    main()
