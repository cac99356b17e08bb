"""One recording, calibrated once in every cell."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.coverage.calibrations import Bench
from benchmarks.coverage.cells import Cell, cells
from benchmarks.coverage.scores import Score, score
from benchmarks.coverage.walks import walk


def recording(seed: int, chosen: Sequence[str], draw: int) -> list[tuple[Cell, Score]]:
    """The scores of the cells whose names have one of the ``chosen`` parts, or of all."""
    walked = walk(seed + draw)
    bench = Bench(walked)
    taken = [cell for cell in cells(walked.rig, draw) if not chosen or any(name in cell.name for name in chosen)]
    return [(cell, score(bench.calibrate(cell.seen, cell.errors, cell.request, draw))) for cell in taken]
