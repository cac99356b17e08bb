"""The figures over all calibrations, and a table of the cells."""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from benchmarks.coverage.cells import RULES, SHARED, Cell
from benchmarks.coverage.scores import Score

Scored = tuple[Cell, Score]
SIX_POSES: Final = "six_poses"
_DEALS: Final = 200


def summary(scored: Sequence[Scored]) -> dict[str, Any]:
    """The figures over all cells; None where there was nothing to take one from."""
    of_cell: dict[str, list[Score]] = defaultdict(list)
    for cell, one in scored:
        of_cell[f"{cell.name}, {cell.seen.lens}" if cell.name.split()[-1] in RULES else cell.name].append(one)
    _print(of_cell)
    # Where the mount turned there is no truth; six poses have a goal of their own.
    held = {name: found for name, found in of_cell.items() if not name.startswith(("second_half", SIX_POSES))}
    covered = {name: coverage(found) for name, found in held.items()}
    sound = [one for cell, one in scored if cell.sound]
    ratios = [one.halves for one in sound if one.halves is not None]
    judged = [one for cell, one in scored if not cell.name.startswith("second_half") and cell.name != SIX_POSES]
    return {
        "worst_coverage95": _rounded(min(covered.values(), default=None)),
        "best_coverage95": _rounded(max(covered.values(), default=None)),
        **_by_chance(held),
        "coverage95": _rounded(float(np.mean(list(covered.values()))) if covered else None),
        **{f"coverage95_{name}": _rounded(part) for name, part in _parts([s for f in held.values() for s in f])},
        "sound_accused": _share([one.status != "ok" for one in sound]),
        "right_model": _share([one.right for one in judged]),
        "halves_ratio_median": _rounded(float(np.median(ratios)) if ratios else None),
        "shared_error_named": _named(of_cell, SHARED),
        **{f"{name}_named": _named(of_cell, (name,)) for name in (*SHARED, "second_half_960", SIX_POSES)},
        **{f"{name}_bound": _bound(of_cell[name]) for name in ("second_half", "second_half_960")},
        "six_poses_coverage95": _rounded(coverage(of_cell[SIX_POSES])) if of_cell[SIX_POSES] else None,
        "sound_doubted": _share([one.doubted for one in sound]),
    }


def coverage(found: Sequence[Score]) -> float:
    """The least share of intervals that hold: of rotation, of translation, of pixels over the marked field."""
    return min(part for _, part in _parts(found))


def _parts(found: Sequence[Score]) -> list[tuple[str, float]]:
    if not found:
        return [(name, 0.0) for name in ("rotation", "t", "pixels")]
    pixels = float(np.mean([one.pixels_held for one in found]))
    return [("rotation", _part(found, "rotation")), ("t", _part(found, "t_")), ("pixels", pixels)]


def _part(found: Sequence[Score], begin: str) -> float:
    return float(
        np.mean([held for one in found for name, held in one.held.items() if name.startswith(begin)] or [0.0])
    )


def _by_chance(of_cell: Mapping[str, Sequence[Score]]) -> dict[str, float | None]:
    """The worst and best coverage to expect if the cells did not differ: medians over deals in which each recording's
    calibrations are dealt to the cells at random.
    """
    if not of_cell or len({len(found) for found in of_cell.values()}) != 1:
        return {"worst_by_chance": None, "best_by_chance": None}
    random = np.random.default_rng(0)
    recordings = [list(one) for one in zip(*of_cell.values(), strict=True)]
    ends: list[tuple[float, float]] = []
    for _ in range(_DEALS):
        dealt = [[one[place] for place in random.permutation(len(one))] for one in recordings]
        covered = [coverage(cell) for cell in zip(*dealt, strict=True)]
        ends.append((min(covered), max(covered)))
    worst, best = np.median(np.array(ends), axis=0).tolist()
    return {"worst_by_chance": _rounded(worst), "best_by_chance": _rounded(best)}


def _named(of_cell: Mapping[str, Sequence[Score]], names: Sequence[str]) -> float | None:
    return _share([one.doubted for name in names for one in of_cell[name]])


def _bound(found: Sequence[Score]) -> float | None:
    bounds = [one.bound for one in found if one.bound is not None]
    return _rounded(float(np.mean(bounds))) if bounds else None


def _print(of_cell: Mapping[str, Sequence[Score]]) -> None:
    columns = ("rotation", "t", "pixels", "true lens", "right", "ok", "doubted", "deg", "mm", "px")
    print(f"{'cell':32}{'runs':>5}" + "".join(f"{name:>10}" for name in columns), file=sys.stderr)
    for name, found in of_cell.items():
        shares = [part for _, part in _parts(found)]
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
