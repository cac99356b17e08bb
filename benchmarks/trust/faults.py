"""What is wrong in each cell: planted before the fit, or after it. A walk's pairs in, what the verdict says out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.camera_models import ModelName
from apexcal.documents.pairs import CLOCK_SIGMA
from benchmarks.coverage.calibrations import Bench
from benchmarks.coverage.marks import Errors, columns
from benchmarks.coverage.walks import Paired, Walked, offset_of, pair, pair_at
from benchmarks.trust.bounds import poses_power, shutter_power
from benchmarks.trust.judging import Judged, agrees_elsewhere, judge

Floats = NDArray[np.float64]
TURNED_DEG: Final = (0.2, 0.5, 1.0)
SHIFTED_M: Final = 0.05
BLUNDERS: Final = 0.10
CLOCK_MS: Final = 40.0
# Rows are read within a frame's period. At 60 frames a second a sensor reads 1308 rows of 12.7 us in 16.6 ms (onsemi,
# AR0330 data sheet, figure 27); at 30 frames a second it has twice as long.
READOUT_MS: Final = (16.6, 33.3)
BENT_M: Final = 0.005
# The marks' part of the image's width and height, about its middle.
MIDDLE: Final = 0.4
_OF_OTHERS: Final = 1000
LENSES: Final[tuple[ModelName, ...]] = ("brown_conrady", "kannala_brandt")


@dataclass(frozen=True)
class Cell:
    """One judged result. ``fault`` is None where nothing is wrong; ``is_named``: by the verdict's own check.

    ``is_asked``: the fault has the size by which the share is judged. ``bound``: the largest share of such cells that
    any test could name, where that is known.
    """

    fault: str | None
    is_named: bool | None
    judged: Judged | None
    is_asked: bool = True
    bound: float | None = None


def cells(walked: Walked, draw: int) -> Iterator[Cell]:
    """Every fault on one walk; the lenses take turns."""
    bench, lens = Bench(walked), LENSES[draw % len(LENSES)]
    paired = pair(walked, lens)
    random = np.random.default_rng([walked.rig.options.seed, 53, draw])
    request = {"models": [lens]}
    clean = judge(bench, paired, columns(paired, Errors(), random), request)
    yield Cell(None, None, clean)
    others = columns(paired, Errors(), np.random.default_rng([walked.rig.options.seed, 59, draw + _OF_OTHERS]))
    yield from _after(clean, others, random)

    def named(fault: str, check: str, known: dict[str, Any], of: Paired = paired, model: ModelName = lens) -> Cell:
        found = judge(bench, of, known, {"models": [model]})
        return Cell(fault, check in found.failed, found)

    yield named("wrong_model", "lens_model", columns(paired, Errors(), random), model="pinhole")
    yield named("bad_marks", "wrong_pairs", columns(paired, Errors(blunders=BLUNDERS), random))
    late = pair(walked, lens, CLOCK_MS)
    yield named("clock", "clock", columns(late, Errors(), random), late)
    yield named("middle", "coverage", _in_the_middle(columns(paired, Errors(), random), paired))
    bent = judge(bench, paired, columns(paired, Errors(pose_m=BENT_M), random), {"models": [lens]})
    yield Cell("bent_board", "shared_errors" in bent.failed, bent, bound=poses_power(bent, BENT_M))
    yield from _shutters(bench, paired, lens, random)


def _shutters(bench: Bench, paired: Paired, lens: ModelName, random: np.random.Generator) -> Iterator[Cell]:
    """Cameras that read their rows one after the other, with synchronised clocks: the offset is known.

    The last one has an offset that was estimated from its own marks. It takes up most of what the rows do.
    """
    for readout_ms in READOUT_MS:
        line_us = 1e3 * readout_ms / paired.camera.image_size[1]
        found = judge(bench, paired, columns(paired, Errors(line_time_us=line_us), random), {"models": [lens]})
        bound = shutter_power(found, line_us, offset_known=True)
        is_named = "rolling_shutter" in found.failed
        yield Cell(f"shutter_{readout_ms:.0f}ms", is_named, found, readout_ms == max(READOUT_MS), bound)
    shutter = Errors(line_time_us=1e3 * max(READOUT_MS) / paired.camera.image_size[1])
    marks = columns(paired, shutter, random)
    offset = offset_of(paired, np.column_stack([marks["u"], marks["v"]]))
    own = pair_at(paired.walked, paired.camera, offset.offset_ns)
    known = columns(own, shutter, random) | {CLOCK_SIGMA: [1e-6 * offset.sigma_ns] * len(own.xyz)}
    found = judge(bench, own, known, {"models": [lens]})
    bound = shutter_power(found, shutter.line_time_us, offset_known=False)
    name = f"shutter_{max(READOUT_MS):.0f}ms_offset_estimated"
    yield Cell(name, "rolling_shutter" in found.failed, found, is_asked=False, bound=bound)


def _after(clean: Judged, others: dict[str, Any], random: np.random.Generator) -> Iterator[Cell]:
    """The mount moves after the fit; another recording's pairs tell. Without a move they must agree."""
    still = agrees_elsewhere(clean, others, np.zeros(3), np.zeros(3))
    yield Cell("(none, other pairs)", not still, None, is_asked=False)
    for degrees in TURNED_DEG:
        found = agrees_elsewhere(clean, others, np.radians(degrees) * _direction(random), np.zeros(3))
        yield Cell(f"turned_{degrees}", not found, None, degrees == max(TURNED_DEG))
    found = agrees_elsewhere(clean, others, np.zeros(3), SHIFTED_M * _direction(random))
    yield Cell("shifted", not found, None)


def _direction(random: np.random.Generator) -> Floats:
    axis = random.normal(size=3)
    return axis / np.linalg.norm(axis)


def _in_the_middle(known: dict[str, Any], paired: Paired) -> dict[str, Any]:
    size = np.array(paired.camera.image_size)
    marks = np.column_stack([known["u"], known["v"]])
    kept = np.flatnonzero(np.all(np.abs(marks - 0.5 * size) < 0.5 * MIDDLE * size, axis=1))
    return {name: [values[i] for i in kept] for name, values in known.items()}
