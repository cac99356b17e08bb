"""`python -m benchmarks.detection`: precision of the detectors on simulated walks, and their speed.

WALKS (default 6) plain walks of 60 s through a field of 10 x 30 m; DRAWN (default 30) walks of 30 s whose sensor,
scene, person and board are drawn; STREETS (default 200) drawn scenes without a board. LEVEL (default 30) drawn walks,
and a third as many streets of 7 seconds: boards are level, and an upper corner is looked for. SHORT=1 does a tenth of
it. ONLY=drawn,streets does parts: plain, drawn, level, streets, speed. SEED repeats a run. SECONDS (60) is the length
of what is timed.
Shares are of the sweeps in which two rings or more meet the board; errors are against the apex at the moment when the
sensor looked at it. One line of JSON goes to stdout.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, TypeVar

from benchmarks.detection.drawn import LEVEL_SWEEPS, STREET_SWEEPS, drawn_figures, run_drawn, run_street
from benchmarks.detection.figures import figures, rounded
from benchmarks.detection.walks import run_plain
from benchmarks.throughput import measure

_SHORT = bool(os.environ.get("SHORT"))
_SECONDS = 20.0 if _SHORT else 60.0
_DRAWN_SECONDS = 15.0 if _SHORT else 30.0
_PARTS = ("plain", "drawn", "level", "streets", "speed")
Asked = TypeVar("Asked")
Answer = TypeVar("Answer")


def main() -> None:
    parts = set((os.environ.get("ONLY") or ",".join(_PARTS)).split(","))
    if not parts <= set(_PARTS):
        sys.exit(f"ONLY names parts out of {', '.join(_PARTS)}, not {', '.join(sorted(parts - set(_PARTS)))}")
    seed = int(os.environ.get("SEED") or secrets.randbits(30))
    answer: dict[str, Any] = {"seed": seed}
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        if "plain" in parts:
            asked = [(walk, _SECONDS) for walk in _seeds(seed, "WALKS", 6)]
            walks = list(_each(pool, run_plain, asked, "plain walks"))
            answer |= {name: figures([walk[name] for walk in walks]) for name in walks[0]}
        if "drawn" in parts:
            asked = [(walk, _DRAWN_SECONDS, 0) for walk in _seeds(seed, "DRAWN", 30)]
            answer["drawn"] = drawn_figures(list(_each(pool, run_drawn, asked, "drawn walks")))
        if "level" in parts:
            corners = [(walk, 1 - 2 * (walk % 2)) for walk in _seeds(seed, "LEVEL", 30)]
            asked = [(walk, _DRAWN_SECONDS, corner) for walk, corner in corners]
            answer["level"] = drawn_figures(list(_each(pool, run_drawn, asked, "level walks")))
            answer["level"]["streets"] = _streets(pool, corners[: max(1, len(corners) // 3)])
        if "streets" in parts:
            answer["streets"] = _streets(pool, [(street, 0) for street in _seeds(seed, "STREETS", 200)])
    if "speed" in parts:
        answer |= measure(float(os.environ.get("SECONDS", "60")), seed)
    print(json.dumps(rounded(answer)))


def _seeds(first: int, name: str, usual: int) -> range:
    return range(first, first + int(os.environ.get(name) or (max(2, usual // 10) if _SHORT else usual)))


def _streets(pool: Executor, asked: Sequence[tuple[int, int]]) -> dict[str, Any]:
    counts = list(_each(pool, run_street, asked, "streets"))
    sweeps = sum(LEVEL_SWEEPS if upper else STREET_SWEEPS for _, upper in asked)
    seeds = [seed for (seed, _), count in zip(asked, counts, strict=True) if count]
    return {"scenes": len(asked), "sweeps": sweeps, "vertices": sum(counts), "seeds": seeds}


def _each(pool: Executor, work: Callable[[Asked], Answer], asked: Sequence[Asked], what: str) -> Iterator[Answer]:
    for done, answer in enumerate(pool.map(work, asked), start=1):
        print(f"\r{done} of {len(asked)} {what}", end="\n" if done == len(asked) else "", file=sys.stderr, flush=True)
        yield answer


if __name__ == "__main__":
    main()
