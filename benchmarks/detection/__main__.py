"""`python -m benchmarks.detection`: precision of the detectors on simulated walks, and their speed.

WALKS (default 6) walks of 60 s each through a field of 10 x 30 m for the plain case, half as many for each other:
distractors, variants, boards that are held rolled, leaning or far from the body, and sensors that spin otherwise.
These take the first of the plain case's walks, so that `share_minus_plain` is no difference of the walks.
DRAWN (default 30) walks of 30 s whose sensor, scene, person and board are drawn, and STREETS (default 200) drawn
scenes without a board. LEVEL (default 30) such walks, and a third as many streets of 7 seconds: boards are level,
and an upper corner is looked for. SHORT=1 does a tenth of it. ONLY=drawn,streets does parts: plain, distractors,
variants, held, spinning, drawn, level, streets, speed. SEED repeats a run; THROUGHPUT_SECONDS (default 60) is the
length of what is timed.
Shares are of the sweeps in which two rings or more meet the board; errors are against the apex at the moment when the
sensor looked at it; pixels at a focal length of 400. One line of JSON goes to stdout.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, TypeVar

from benchmarks.detection.cases import GROUPS, PLAIN, PLAIN_REFINED
from benchmarks.detection.drawn import (
    LEVEL_SWEEPS,
    STREET_SWEEPS,
    drawn_figures,
    road_vertices,
    run_drawn,
    run_street,
)
from benchmarks.detection.figures import figures, rounded
from benchmarks.detection.walks import Found, run
from benchmarks.throughput import measure

_SHORT = bool(os.environ.get("SHORT"))
_SECONDS = 20.0 if _SHORT else 60.0
_DRAWN_SECONDS = 15.0 if _SHORT else 30.0
_PARTS = ("plain", *GROUPS, "drawn", "level", "streets", "speed")
Asked = TypeVar("Asked")
Answer = TypeVar("Answer")


def main() -> None:
    parts = set((os.environ.get("ONLY") or ",".join(_PARTS)).split(","))
    if not parts <= set(_PARTS):
        sys.exit(f"ONLY names parts out of {', '.join(_PARTS)}, not {', '.join(sorted(parts - set(_PARTS)))}")
    walks = _count("WALKS", 6)
    seed = int(os.environ.get("SEED") or secrets.randbits(30))
    answer: dict[str, Any] = {}
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        answer |= _walked(pool, parts, walks, seed)
        if "drawn" in parts:
            asked = [(seed + number, _DRAWN_SECONDS, 0) for number in range(_count("DRAWN", 30))]
            answer["drawn"] = drawn_figures(list(_each(pool, run_drawn, asked, "drawn walks")))
        if "level" in parts:
            corners = [(seed + number, 1 - 2 * (number % 2)) for number in range(_count("LEVEL", 30))]
            asked = [(walk, _DRAWN_SECONDS, corner) for walk, corner in corners]
            answer["level"] = drawn_figures(list(_each(pool, run_drawn, asked, "level walks")))
            answer["level"]["streets"] = _streets(pool, corners[: max(1, len(corners) // 3)])
        if "streets" in parts:
            answer["streets"] = _streets(pool, [(seed + number, 0) for number in range(_count("STREETS", 200))])
    answer |= {"walks": walks, "seconds_each": _SECONDS, "seed": seed}
    if "speed" in parts:
        answer |= measure(float(os.environ.get("THROUGHPUT_SECONDS", "60")))
    print(json.dumps(rounded(answer)))


def _count(name: str, usual: int) -> int:
    return int(os.environ.get(name) or (max(2, usual // 10) if _SHORT else usual))


def _walked(pool: Executor, parts: set[str], walks: int, seed: int) -> dict[str, Any]:
    fewer = max(1, walks // 2)
    groups = {group: members for group, members in GROUPS.items() if group in parts}
    plain, count = (PLAIN, walks) if "plain" in parts else (PLAIN_REFINED, fewer if groups else 0)
    asked = [(plain, seed + number, _SECONDS) for number in range(count)]
    asked += [
        (case, seed + number, _SECONDS) for members in groups.values() for case in members for number in range(fewer)
    ]
    found: dict[tuple[str, str], list[Found]] = defaultdict(list)
    for several in _each(pool, run, asked, "walks"):
        for one in several:
            found[one.case, one.key].append(one)
    results = {key: figures(of_case) for key, of_case in found.items()}
    if groups:
        _compare(results, figures(found["plain", "refined"][:fewer])["accepted_share"])
    answer: dict[str, Any] = {key: results["plain", key] for key in PLAIN.detectors} if "plain" in parts else {}
    for group, members in groups.items():
        answer[group] = {case.name: results[case.name, "refined"] for case in members}
    return answer


def _compare(results: dict[tuple[str, str], dict[str, Any]], share: float) -> None:
    """Adds to each other case by how much its share differs from that of the plain case on the same walks."""
    for (case, _), result in results.items():
        if case != "plain":
            result["share_minus_plain"] = result["accepted_share"] - share


def _streets(pool: Executor, asked: Sequence[tuple[int, int]]) -> dict[str, Any]:
    counts = list(_each(pool, run_street, asked, "streets"))
    sweeps = sum(LEVEL_SWEEPS if upper else STREET_SWEEPS for _, upper in asked)
    false = {"scenes": len(asked), "sweeps": sweeps, "vertices": sum(counts), "share": sum(counts) / max(sweeps, 1)}
    false |= {
        "seeds": [seed for (seed, _), count in zip(asked, counts, strict=True) if count],
        "road": road_vertices(),
    }
    return false


def _each(pool: Executor, work: Callable[[Asked], Answer], asked: Sequence[Asked], what: str) -> Iterator[Answer]:
    for done, answer in enumerate(pool.map(work, asked), start=1):
        print(f"\r{done} of {len(asked)} {what}", end="\n" if done == len(asked) else "", file=sys.stderr, flush=True)
        yield answer


if __name__ == "__main__":
    main()
