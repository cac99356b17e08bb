"""Remedies followed literally: what becomes of a result's error and intervals if it is calibrated as trials advise.

The draws have errors that all pairs share as well, as large as the request states, so that intervals can hold.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from apexcal.documents.errors import DocumentError
from benchmarks.judge.cases import CASES, KEPT, Case, Draw
from benchmarks.judge.judging import BROKEN, PointError, as_stated, error_of, searched
from benchmarks.judge.walk_cases import FREE_LENS
from benchmarks.shares import share
from service.platform.db.calibrations import FULL
from service.platform.http.problems import Problem
from workers.solver.outcomes import SolveError
from workers.tasks.remedies import applied, trials_of

_NAMES: Final = ("clocks apart", "wrong prior", "lens of another camera", "wrong model")
REMEDIED: Final = (*(case for case in CASES if case.name in _NAMES), KEPT, FREE_LENS)


class Followed(NamedTuple):
    """A draw and the remedy that its trials advise: the check it is of, or why there is none; errors of points."""

    case: str
    check: str
    before: PointError | None = None
    after: PointError | None = None


def followed(asked: tuple[int, int]) -> Followed:
    """The draw of a case, by its number in `REMEDIED`, and a seed."""
    case, seed = REMEDIED[asked[0]], asked[1]
    random = np.random.default_rng([seed, 67])
    try:
        return _followed(case, as_stated(case.make(seed, random), random))
    except (DocumentError, Problem, SolveError):
        return Followed(case.name, "refused")
    except Exception:
        print(f"{case.name}, seed {seed}: a trial broke\n{traceback.format_exc()}", file=sys.stderr)
        return Followed(case.name, BROKEN)


def _followed(case: Case, draw: Draw) -> Followed:
    fit, _, state, result = searched(draw)
    trials = trials_of(fit.of_fold(FULL), draw.known, state, result)
    best = next((remedy for remedy, trial in trials if trial.outcome == "helps"), None)
    before = error_of(draw, result)
    if best is None:
        return Followed(case.name, "none helps" if trials else "none", before)
    return Followed(case.name, best.check, before, error_of(draw, applied(best, result.model, state)[0]))


def remedies_table(outcomes: Sequence[Followed]) -> str:
    """Each case as a line: how often a remedy helps, and the errors of those draws before and after it."""
    head = ("case", "draws", "followed", "RMS px before", "after", "worse", "95 % held before", "after", "remedies")
    rows = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    names = [case.name for case in REMEDIED if any(one.case == case.name for one in outcomes)]
    for name in (*names, "all"):
        of_case = [one for one in outcomes if name in (one.case, "all")]
        done = [(one.before, one.after) for one in of_case if one.before and one.after]
        checks = [one.check for one in of_case if one.after]
        told = ", ".join(f"{check} {checks.count(check)}" for check in sorted(set(checks)))
        worse = sum(after.px > before.px for before, after in done)
        sizes = [_rms(one) for one in zip(*done, strict=True)] if done else [float("nan")] * 2
        held = [float(np.mean([each.held for each in one])) for one in zip(*done, strict=True)] or [float("nan")] * 2
        rows.append(
            f"| {name} | {len(of_case)} | {share(len(done), len(of_case))} | {sizes[0]:.2f} | {sizes[1]:.2f} | "
            f"{share(worse, len(done))} | {held[0]:.3f} | {held[1]:.3f} | {told} |"
        )
    return "\n".join(rows)


def _rms(errors: Sequence[PointError]) -> float:
    return float(np.sqrt(np.mean([each.px**2 for each in errors])))


def remedies_summary(outcomes: Sequence[Followed]) -> dict[str, Any]:
    """Of all followed remedies: how many, RMS errors before and after, and the share within intervals after."""
    done = [(one.before, one.after) for one in outcomes if one.before and one.after]
    if not done:
        return {"draws": len(outcomes), "followed": 0}
    before, after = zip(*done, strict=True)
    held = round(float(np.mean([each.held for each in after])), 3)
    sizes = {"rms_px_before": round(_rms(before), 3), "rms_px_after": round(_rms(after), 3)}
    return {"draws": len(outcomes), "followed": len(done), **sizes, "held_after": held}
