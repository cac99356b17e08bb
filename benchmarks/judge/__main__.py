"""`python -m benchmarks.judge`: is what is published by itself right, and are sound calibrations published?

Every case draws rigs, lenses, walks and marks anew and goes the product's way: request, search, fit, held-out pairs,
checks. Beside the cases stand walks (clocks and lenses nearly right, people's habits) and remedies that are followed.
DRAWS: of everything at most so many; ONLY: parts of the names of cases, or `remedies`;
SEED: of the first draw; WORKERS: processes.
A calibration is published by itself if all its checks pass. It is wrong if points at 20 m, over the field that marks
cover, are off by more than 3 stated deviations and by more than 2 px and 1.5 mrad.

Tables go to stderr, with 95 % intervals (Clopper and Pearson 1934): the cases and walks, what is true of them, which
check finds what, as `docs/checks.md` has it, and remedies. One line of JSON goes to stdout. Of each case the first 60
draws make the table of checks; the others hold pairs out only where the fit's own checks pass, which changes no
verdict on publishing.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, Final

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

from benchmarks.judge.cases import CASES, Case  # noqa: E402
from benchmarks.judge.judging import ALL, BROKEN, CAUSES, Outcome, numbered  # noqa: E402
from benchmarks.judge.remedies import REMEDIED, followed, remedies_summary, remedies_table  # noqa: E402
from benchmarks.judge.walk_cases import WALKS, WHOLE_WALK  # noqa: E402
from benchmarks.shares import interval, share  # noqa: E402
from workers.solver.slot import warm_up  # noqa: E402

IN_TABLE: Final = 60
NAMED: Final = 0.05
"""A case is named beside a check that finds this share of its draws."""
SOUND, FAULTS, WHOLE, WALKED, FOLLOWED = 300, 60, 25, 60, 50
"""Draws of each sound case, each other case, each cell of whole walks, each other walk, each case with remedies."""


def main() -> None:
    """Judge all draws of all cases, and print the figures."""
    draws, seed = int(os.environ.get("DRAWS", "300")), int(os.environ.get("SEED") or secrets.randbelow(10**8))
    only = [part for part in os.environ.get("ONLY", "").split(",") if part]
    chosen = [case for case in ALL if not only or any(part in case.name for part in only)]
    cases, walks = [case for case in chosen if case in CASES], [case for case in chosen if case in WALKS]
    began = time.perf_counter()
    asked = [
        (ALL.index(case), seed + draw, draw < IN_TABLE)
        for draw in range(draws)
        for case in chosen
        if draw < _most(case)
    ]
    to_follow = range(min(draws, FOLLOWED) if not only or "remedies" in only else 0)
    remedied = [(number, seed + draw) for draw in to_follow for number in range(len(REMEDIED))]
    workers = int(os.environ.get("WORKERS") or os.cpu_count() or 1)
    with ProcessPoolExecutor(workers, get_context("spawn"), warm_up) as pool:
        outcomes = list(pool.map(numbered, asked, chunksize=4))
        trials = list(pool.map(followed, remedied, chunksize=2))
    by_case = {case.name: [one for one in outcomes if one.case == case.name] for case in chosen}
    tables = [cases_table(cases, by_case), truth_table(chosen, by_case), checks_table(cases, by_case)]
    tables += [remedies_table(trials)] if trials else []
    print(*tables, sep="\n\n", file=sys.stderr)
    said = {"bench": "judge", "seed": seed, "draws": draws, **summary(cases, by_case)}
    said |= {"walks": walks_summary(walks, by_case), "remedies": remedies_summary(trials)}
    print(json.dumps(said | {"seconds": round(time.perf_counter() - began, 1)}))
    sys.exit(BROKEN in {*(one.verdict for one in outcomes), *(one.check for one in trials)})


def _most(case: Case) -> int:
    if case in CASES:
        return SOUND if case.is_sound else FAULTS
    return WHOLE if case.name.startswith(WHOLE_WALK) else WALKED


def walks_summary(walks: Sequence[Case], by_case: dict[str, list[Outcome]]) -> dict[str, Any]:
    """Figures of whole walks, each as count, of how many, and its interval; sound is what lies within use.

    ``people``: draws in which a habit is told, or else the share of coordinates within their stated intervals.
    """
    results = [(case, one) for case in walks for one in by_case[case.name] if one.verdict not in ("refused", BROKEN)]
    whole = [(case, one) for case, one in results if case.is_sound]
    sound = [one for _, one in whole if one.over_limit <= 1.0]
    named = [(name in case.causes) for case, one in results for name in one.named]
    stops = [one.over_limit > 1.0 for _, one in whole if one.verdict == "stop"]
    figures: dict[str, Any] = {
        "sound_published": _share([one.verdict == "pass" for one in sound]),
        "published_wrong": _share([one.is_wrong for _, one in whole if one.verdict == "pass"]),
        "stopped_beyond_limit": _share(stops),
        "causes_named_right": _share(named),
    }
    for case in walks:
        if "people" in case.causes:
            held = [1.0 if "people" in one.named else one.held for of, one in results if of is case]
            figures[case.name] = {
                "draws": len(held),
                "told_or_held": round(float(np.mean(held)), 3) if held else None,
            }
    return figures


def _share(is_so: Sequence[bool]) -> list[float] | None:
    count, of = sum(is_so), len(is_so)
    return [count, of, *(round(end, 4) for end in interval(count, of))] if of else None


def summary(cases: Sequence[Case], by_case: dict[str, list[Outcome]]) -> dict[str, Any]:
    """The asked figures: of cases with a trace in the residuals, but for the intervals of sound ones."""
    traced = [one for case in cases if case.has_trace for one in by_case[case.name]]
    wrong = {case.name: _wrong(by_case[case.name]) for case in cases if case.has_trace}
    sound = [one for case in cases if case.is_sound for one in by_case[case.name]]
    published, stopped = (sum(one.verdict == verdict for one in sound) for verdict in ("pass", "stop"))
    figures: dict[str, Any] = {
        "broken": sum(one.verdict == BROKEN for of_case in by_case.values() for one in of_case),
        "published_wrong_worst_case": max(wrong.values(), default=None),
        "published_wrong": sum(wrong.values()),
        "published_wrong_upper": round(interval(sum(wrong.values()), len(traced))[1], 5) if traced else None,
    }
    for name, count in (("sound_published", published), ("sound_stopped", stopped)):
        figures[name] = round(count / len(sound), 4) if sound else None
        figures[f"{name}_interval"] = [round(end, 4) for end in interval(count, len(sound))] if sound else None
    accused = ["precision" in one.failed for one in sound if one.verdict != "refused"]
    at_use = np.array([one.at_use for one in sound if one.verdict != "refused"])
    for name, chosen in (("accused", np.array(accused, np.bool_)), ("others", ~np.array(accused, np.bool_))):
        # Right is an accusation if the middle 95 % of such results are not within what use allows.
        worst = round(float(np.quantile(at_use[chosen], 0.95)), 3) if chosen.any() else None
        figures[f"precision_{name}"] = {"draws": int(chosen.sum()), "error_over_limit_95": worst}
    clean, hand = (_median_px(by_case.get(name, [])) for name in ("people, none wrong", "15 % on the hand"))
    return figures | {"median_px_15_over_none": round(hand / clean, 3) if clean and hand else None}


def _wrong(outcomes: Sequence[Outcome]) -> int:
    return sum(one.verdict == "pass" and one.is_wrong for one in outcomes)


def _median_px(outcomes: Sequence[Outcome]) -> float | None:
    errors = [one.error_px for one in outcomes if np.isfinite(one.error_px)]
    return float(np.median(errors)) if errors else None


def cases_table(cases: Sequence[Case], by_case: dict[str, list[Outcome]]) -> str:
    """Each case as a line: shares with their intervals, and the median error."""
    head = ("case", "draws", "published", "and wrong", "look", "stop", "refused", "median px")
    rows = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for case in cases:
        found = by_case[case.name]
        counts = [sum(one.verdict == verdict for one in found) for verdict in ("pass", "look", "stop", "refused")]
        counts.insert(1, _wrong(found))
        shares = " | ".join(share(count, len(found)) for count in counts)
        name = case.name if case.has_trace else f"({case.name})"
        rows.append(f"| {name} | {len(found)} | {shares} | {_median_px(found) or float('nan'):.2f} |")
    return "\n".join(rows)


def truth_table(cases: Sequence[Case], by_case: dict[str, list[Outcome]]) -> str:
    """Each case as a line, by what is true: points within use or not, their verdicts, intervals, and causes told."""
    head = ("case", "within use", "of these published", "stopped", "others published", "stated 95 % held", "told")
    rows = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for case in cases:
        results = [each for each in by_case[case.name] if each.verdict not in ("refused", BROKEN)]
        good = [each for each in results if each.over_limit <= 1.0]
        bad = [each for each in results if each.over_limit > 1.0]
        published, stopped = (sum(each.verdict == word for each in good) for word in ("pass", "stop"))
        held = float(np.mean([each.held for each in results])) if results else float("nan")
        told = {name: sum(name in each.named for each in results) for name in CAUSES}
        causes = ", ".join(f"{name} {count}" for name, count in told.items() if count)
        others = f"{sum(each.verdict == 'pass' for each in bad)} of {len(bad)}"
        rows.append(
            f"| {case.name} | {len(good)} of {len(results)} | {published} | {stopped} | {others} | {held:.3f} | "
            f"{causes} |"
        )
    return "\n".join(rows)


def checks_table(cases: Sequence[Case], by_case: dict[str, list[Outcome]]) -> str:
    """Each check as a line: of how many sound draws it says look or stop, and of which share of each other case."""
    draws = {case: by_case[case.name][:IN_TABLE] for case in cases}
    sound = [one for case in cases if case.is_sound for one in draws[case]]
    faults = [case for case in cases if not case.is_sound]
    rows = [f"| Check | Accuses, of {len(sound)} sound | Finds |", "|---|---|---|"]
    for name in sorted({name for outcomes in draws.values() for one in outcomes for name in one.failed}):
        shares = {case.name: float(np.mean([name in one.failed for one in draws[case]])) for case in faults}
        named = sorted((case for case in shares if shares[case] >= NAMED), key=lambda case: -shares[case])
        rest = "; ".join(f"{case} {shares[case]:.2f}" for case in named)
        rows.append(f"| `{name}` | {sum(name in one.failed for one in sound)} | {rest} |")
    return "\n".join(rows)


if __name__ == "__main__":
    main()
