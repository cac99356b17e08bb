"""`make bench-marks`: see the docstring of the package. SHORT=1 draws fewer scenes, FIRST is the first one's seed.

The scenes of seeds from 500 on judge. Nothing was chosen by them: development drew seeds from 9000 on and 0 to 15.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from apexcal.documents.corners import CORNERS
from benchmarks.marks import calibrated
from benchmarks.marks.chance import offers_mount
from benchmarks.marks.draws import CELLS, Draw
from benchmarks.marks.real import tell_real
from benchmarks.marks.rendered import CornerCounts, SceneOutcome, quantiles, run_cell, run_scene
from benchmarks.shares import share

SCENES: Final = 100
_CHANCE: Final = 300
_CELL_SCENES: Final = 20
_KINDS: Final[dict[str, Callable[[Draw], bool]]] = {
    "still poses": lambda drawn: drawn.still,
    "patterned boards": lambda drawn: drawn.pattern != "plain",
    "blur above 1.5 px": lambda drawn: drawn.blur_px > 1.5,
    "head above the tip": lambda drawn: drawn.head_above_m > 0.0,
    "second walker": lambda drawn: drawn.second != "none",
    "fisheye": lambda drawn: drawn.model == "kannala_brandt",
    "no size": lambda drawn: not drawn.size_stated,
    "thermal": lambda drawn: drawn.thermal,
}


def main() -> None:
    short = bool(os.environ.get("SHORT"))
    start = time.monotonic()
    scenes, chance = (16, 60) if short else (SCENES, _CHANCE)
    first = int(os.environ.get("FIRST", "500"))
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        outcomes = [one for one in pool.imap_unordered(run_scene, range(first, first + scenes)) if one is not None]
        cells = [(seed, cell) for cell in CELLS for seed in range(first, first + (4 if short else _CELL_SCENES))]
        of_cells = list(pool.imap(run_cell, cells))
        offered = sum(pool.imap_unordered(offers_mount, range(first, first + chance), chunksize=5))
    print(f"{len(outcomes)} of {scenes} drawn scenes show the board in 8 frames or more\n")
    _tell("all", outcomes)
    for kind, holds in _KINDS.items():
        _tell(kind, [one for one in outcomes if holds(one.drawn)])
    for cell in CELLS:
        _tell(f"edges of cell {cell!r}", [one for name, one in of_cells if name == cell and one is not None])
    for name in CORNERS[1:]:
        _tell_corners(f"{name} corners", _merged(outcomes, name))
    large = [one for one in outcomes if one.drawn.size[0] == 1920]
    print(f"\nprocessor seconds a frame of 1920 pixels' width: {quantiles([one.seconds for one in large])}")
    print(f"scenes without a board: a mount is offered in {share(offered, chance)}")
    print(f"drawn, rendered and marked in {time.monotonic() - start:.0f} s\n")
    calibrated.main()
    print()
    tell_real()


def _tell(kind: str, outcomes: Sequence[SceneOutcome]) -> None:
    counts = _merged(outcomes, "top")
    failures = Counter(one.failure for one in outcomes if one.failure)
    _tell_corners(f"{kind}: {len(outcomes)} scenes", counts)
    if failures:
        print("   without a mount: " + ", ".join(f"{count} {reason}" for reason, count in failures.items()))


def _merged(outcomes: Sequence[SceneOutcome], name: str) -> CornerCounts:
    merged = CornerCounts()
    for one in outcomes:
        for corner, counts in one.corners.items():
            if corner == name:
                merged.add(counts)
    return merged


def _tell_corners(title: str, counts: CornerCounts) -> None:
    errors, scores = np.array(counts.errors_px), np.array(counts.scores)
    print(title)
    print(f"   offered {share(len(errors), counts.visible)}, px {quantiles(counts.errors_px)}")
    print(f"   within 1 px {share(int(np.sum(errors <= 1.0)), len(errors))}")
    if len(errors):
        worst = scores.reshape(-1, 2).max(axis=1)
        good = int(np.sum((errors <= 2.0) | (worst <= 3.0)))
        print(f"   within 2 px or 3 stated deviations {share(good, len(errors))}")
    print(f"   beyond 5 px {share(int(np.sum(errors > 5.0)), len(errors))}")
    print(f"   within 1 and 1.96 stated deviations {share(int(np.sum(scores <= 1.0)), len(scores))}", end=", ")
    print(share(int(np.sum(scores <= 1.96)), len(scores)))
    if counts.refused:
        print("   refused: " + ", ".join(f"{count} {reason}" for reason, count in counts.refused.most_common()))


if __name__ == "__main__":
    main()
