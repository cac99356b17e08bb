"""What is wrong in each cell: planted before the fit, or after it. A walk's pairs in, what the verdict says out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.camera_models import ModelName
from benchmarks.coverage.calibrations import Bench
from benchmarks.coverage.marks import Errors, columns
from benchmarks.coverage.walks import Paired, Walked, pair
from benchmarks.trust.judging import Judged, agrees_elsewhere, judge

Floats = NDArray[np.float64]
TURNED_DEG: Final = (0.2, 0.5, 1.0)
SHIFTED_M: Final = 0.05
BLUNDERS: Final = 0.10
CLOCK_MS: Final = 40.0
# A frame of 600 rows that is read in 1/30 s.
LINE_TIME_US: Final = 55.0
BENT_M: Final = 0.005
# The marks' part of the image's width and height, about its middle.
MIDDLE: Final = 0.4
_OF_OTHERS: Final = 1000
LENSES: Final[tuple[ModelName, ...]] = ("brown_conrady", "kannala_brandt")


@dataclass(frozen=True)
class Cell:
    """One judged result. ``fault`` is None where nothing is wrong; ``is_named``: by the verdict's own check.

    ``is_asked``: the fault has the size by which the share is judged.
    """

    fault: str | None
    is_named: bool | None
    judged: Judged | None
    is_asked: bool = True


def cells(walked: Walked, draw: int) -> Iterator[Cell]:
    """Every fault on one walk; the lenses take turns."""
    bench, lens = Bench(walked), LENSES[draw % len(LENSES)]
    paired = pair(walked, lens)
    random = np.random.default_rng([walked.rig.settings.seed, 53, draw])
    request = {"models": [lens]}
    clean = judge(bench, paired, columns(paired, Errors(), random), request)
    yield Cell(None, None, clean)
    others = columns(paired, Errors(), np.random.default_rng([walked.rig.settings.seed, 59, draw + _OF_OTHERS]))
    yield from _after(clean, others, random)

    def named(fault: str, check: str, known: dict[str, Any], of: Paired = paired, model: ModelName = lens) -> Cell:
        found = judge(bench, of, known, {"models": [model]})
        return Cell(fault, check in found.failed, found)

    yield named("wrong_model", "off_axis", columns(paired, Errors(), random), model="pinhole")
    yield named("bad_marks", "wrong_pairs", columns(paired, Errors(blunders=BLUNDERS), random))
    late = pair(walked, lens, CLOCK_MS)
    yield named("clock", "clock", columns(late, Errors(), random), late)
    yield named("middle", "coverage", _in_the_middle(columns(paired, Errors(), random), paired))
    yield named("bent_board", "shared_errors", columns(paired, Errors(pose_m=BENT_M), random))
    shutter = Errors(line_time_us=LINE_TIME_US)
    yield named("rolling_shutter", "rolling_shutter", columns(paired, shutter, random))


def _after(clean: Judged, others: dict[str, Any], random: np.random.Generator) -> Iterator[Cell]:
    """The mount moves after the fit; another recording's pairs tell. Without a move they must agree."""
    still = agrees_elsewhere(clean, others, np.zeros(3), np.zeros(3))
    yield Cell("(none, other pairs)", None if still is None else not still, None, is_asked=False)
    for degrees in TURNED_DEG:
        found = agrees_elsewhere(clean, others, np.radians(degrees) * _direction(random), np.zeros(3))
        yield Cell(f"turned_{degrees}", None if found is None else not found, None, degrees == max(TURNED_DEG))
    found = agrees_elsewhere(clean, others, np.zeros(3), SHIFTED_M * _direction(random))
    yield Cell("shifted", None if found is None else not found, None)


def _direction(random: np.random.Generator) -> Floats:
    axis = random.normal(size=3)
    return axis / np.linalg.norm(axis)


def _in_the_middle(known: dict[str, Any], paired: Paired) -> dict[str, Any]:
    size = np.array(paired.camera.image_size)
    marks = np.column_stack([known["u"], known["v"]])
    kept = np.flatnonzero(np.all(np.abs(marks - 0.5 * size) < 0.5 * MIDDLE * size, axis=1))
    return {name: [values[i] for i in kept] for name, values in known.items()}
