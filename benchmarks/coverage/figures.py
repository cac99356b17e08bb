"""The figures over all calibrations, and a table of the cells."""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.coverage.cells import RULES, SHARED, Cell
from benchmarks.coverage.scores import Score

Scored = tuple[Cell, Score]


def summary(scored: Sequence[Scored]) -> dict[str, Any]:
    """The figures over all cells; None where there was nothing to take one from."""
    of_cell: dict[str, list[Score]] = defaultdict(list)
    for cell, one in scored:
        of_cell[f"{cell.name}, {cell.lens}" if cell.name.split()[-1] in RULES else cell.name].append(one)
    covered = {name: _coverage(found) for name, found in of_cell.items() if name != "second_half"}
    _print(of_cell)
    sound = [one for cell, one in scored if cell.sound]
    shared = [one for cell, one in scored if cell.name in SHARED]
    ratios = [one.halves for one in sound if one.halves is not None]
    return {
        "worst_coverage95": _rounded(min(covered.values(), default=None)),
        "best_coverage95": _rounded(max(covered.values(), default=None)),
        "coverage95": _rounded(float(np.mean(list(covered.values()))) if covered else None),
        "sound_accused": _share([one.status != "ok" for one in sound]),
        "right_model": _share([one.right for cell, one in scored if cell.name != "second_half"]),
        "halves_ratio_median": _rounded(float(np.median(ratios)) if ratios else None),
        "shared_error_named": _share([one.doubted for one in shared]),
        "sound_doubted": _share([one.doubted for one in sound]),
    }


def _coverage(found: Sequence[Score]) -> float:
    return min(_part(found, "rotation"), _part(found, "t_"), float(np.mean([one.pixels_held for one in found])))


def _part(found: Sequence[Score], begin: str) -> float:
    return float(
        np.mean([held for one in found for name, held in one.held.items() if name.startswith(begin)] or [0.0])
    )


def _print(of_cell: dict[str, list[Score]]) -> None:
    columns = ("rotation", "t", "pixels", "true lens", "right", "ok", "doubted", "deg", "mm", "px")
    print(f"{'cell':32}{'runs':>5}" + "".join(f"{name:>10}" for name in columns), file=sys.stderr)
    for name, found in of_cell.items():
        shares = [_part(found, "rotation"), _part(found, "t_"), float(np.mean([one.pixels_held for one in found]))]
        right, ok, doubt = (np.mean([getattr(one, key) for one in found]) for key in ("right", "sound", "doubted"))
        errors = [
            float(np.median([getattr(one, key) for one in found])) for key in ("error_deg", "error_mm", "field_px")
        ]
        true_lens = np.mean([one.of_true_lens for one in found])
        values = [*shares, float(true_lens), float(right), float(ok), float(doubt), *errors]
        print(f"{name:32}{len(found):5}" + "".join(f"{value:10.2f}" for value in values), file=sys.stderr)


def _share(values: Sequence[bool]) -> float | None:
    return _rounded(float(np.mean(values))) if values else None


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
