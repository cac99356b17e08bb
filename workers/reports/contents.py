"""Everything that a report shows, as one JSON document: what the result's page reads of the service, and more."""

from __future__ import annotations

from collections import defaultdict
from typing import Any, Final

import numpy as np

from apexcal.documents.checks import verdict_of
from apexcal.documents.results import OutlierPair
from workers.reports.material import Material

Json = dict[str, Any]
# Columns of a pair that a report repeats, where the set has them.
_COLUMNS: Final = ("group", "sweep_index", "frame_index", "marks", "spread_px", "corner")
# A hundredth of a millimetre and a thousandth of a pixel: finer than what is measured.
_DECIMALS: Final = {"x": 5, "y": 5, "z": 5, "u": 3, "v": 3}
# The page computes residuals from pairs; it shows no history of the search.
_LEFT_OUT: Final = {"residuals_px", "history", "heldout", "evaluations"}


def contents(material: Material) -> Json:
    """Return the report's document; ``frontend/src/lib/report.ts`` says how the page reads it.

    Its result is a ``ResultView`` whose residuals are left to the page. Pairs are columns in the order of their set:
    pixels, and metres in the LiDAR's frame as they were fitted. With a rolling shutter that is where the vertex was
    when its mark's row was read.
    """
    return {
        "names": dict(material.names),
        "made_at": material.made_at,
        "result": _result(material),
        "summary": material.summary,
        "pairs": _pairs(material),
        "upper_corner": material.upper_corner,
        "people": _people(material),
        "elsewhere": list(material.elsewhere),
        "request": material.request,
    }


def _result(material: Material) -> Json:
    document = material.result.model_dump(mode="json", exclude=_LEFT_OUT, exclude_unset=True)
    for outlier in document["outliers"]:
        names = [name for name in OutlierPair.model_fields if name in material.pairs]
        outlier["pair"] = {name: material.pairs[name][outlier["index"]] for name in names}
    return document | {
        "checks": [check.model_dump(mode="json") for check in material.checks],
        "verdict": verdict_of(material.checks, "mount_with_lens"),
        "verdict_alone": verdict_of(material.checks, "mount_alone"),
        **material.rows,
    }


def _pairs(material: Material) -> Json:
    """Columns of equal lengths; the held-out errors are null where no fold held the pair out."""
    problem = material.problem
    measured = dict(zip("xyzuv", [*problem.points.T, *problem.pixels.T], strict=True))
    columns: Json = {name: np.round(measured[name], digits).tolist() for name, digits in _DECIMALS.items()}
    columns |= {name: material.pairs[name] for name in _COLUMNS if name in material.pairs}
    if "stamp_ns" in material.pairs:
        # Beyond what numbers of a browser hold exactly.
        columns["stamp_ns"] = [str(stamp) for stamp in material.pairs["stamp_ns"]]
    errors_px: list[float | None] = [None] * len(problem.points)
    for fold in material.heldout:
        for index, error_px in zip(fold.indices or [], fold.errors_px or [], strict=True):
            errors_px[index] = round(error_px, 3)
    return columns | {"heldout_px": errors_px}


def _people(material: Material) -> list[Json]:
    """Each person's marks: the numbers of their pairs, and pixels."""
    by_person: dict[str, Json] = defaultdict(lambda: {"pair": [], "u": [], "v": []})
    for mark in material.marks:
        for name in ("pair", "u", "v"):
            by_person[mark.person][name].append(round(getattr(mark, name), 3))
    return [{"name": person, **columns} for person, columns in sorted(by_person.items())]
