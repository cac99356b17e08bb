"""Everything that a report shows, as one JSON document: its plots are drawn from this and nothing else."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from workers.reports.coverage import field_of, missing
from workers.reports.maps import ground_map, image_map
from workers.reports.material import Material
from workers.reports.pair_errors import PairErrors, held_out_px, pair_errors, rings_of
from workers.reports.rounding import rounded, tidy
from workers.reports.verdict import sentence_of

Json = dict[str, Any]
LAYOUT = 1
# Columns of a pair that a report repeats, where the set has them.
_KNOWN = ("x", "y", "z", "u", "v", "stamp_ns", "group", "sweep_index", "frame_index", "marks", "spread_px", "corner")
_SHOWN_OF_RESULT = {
    *("model", "status", "message", "search", "loss", "weights", "pairs", "free_parameters", "iterations", "stopped"),
    *("polished", "ga", "baseline", "linear_baseline", "kept", "parameters", "intrinsics", "transform", "at_bounds"),
    *("std", "interval95_half_width", "degrees_of_freedom", "correlation", "covariance", "worst_correlation"),
    *("sigma_px", "noise_scale", "explained_px", "marks_outside", "shared_errors", "common_errors"),
    *("weak_priors", "lens", "stated_lens", "halves", "prediction", "outliers"),
    *("versions", "cpu"),
}


def contents(material: Material) -> Json:
    """The report's numbers: metres in the LiDAR's frame, pixels, degrees; of N pairs in the order of their set."""
    result = material.chosen.result
    errors = pair_errors(result, material.chosen.problem.points, material.chosen.problem.pixels)
    used = material.chosen.problem.weights > 0.0
    used[[item.index for item in result.outliers]] = False
    field = field_of(material, errors)
    return tidy(
        {
            "layout": LAYOUT,
            "names": dict(material.names),
            "ids": dict(material.ids),
            "made_at": material.made_at,
            "verdict": sentence_of(result, material.checks)._asdict(),
            "checks": [item.model_dump() for item in material.checks],
            "rings": rings_of(errors, used),
            "result": result.model_dump(include=_SHOWN_OF_RESULT, exclude_unset=True),
            "recommended": material.recommended,
            "why": material.why,
            "models": _models(material),
            "coverage": field._asdict() | {"missing": missing(field)},
            "slots": _slots(material),
            "people": _people(material, errors),
            "elsewhere": list(material.elsewhere),
            "request": material.request,
            "provenance": result.provenance and result.provenance.model_dump(),
        }
    ) | {"pairs": _pairs(material, errors)}


def _pairs(material: Material, errors: PairErrors) -> Json:
    """Columns of equal lengths; whole numbers stay as they are."""
    count = len(material.pairs["x"])
    columns: Json = {name: material.pairs[name] for name in _KNOWN if name in material.pairs}
    for name in ("x", "y", "z", "u", "v"):
        columns[name] = rounded(columns[name])
    columns |= {
        "projected_u": rounded(errors.projected[:, 0]),
        "projected_v": rounded(errors.projected[:, 1]),
        "off_u": rounded(errors.off[:, 0]),
        "off_v": rounded(errors.off[:, 1]),
        "error_px": rounded(errors.distance_px),
        "range_m": rounded(errors.range_m),
        "angle_deg": rounded(errors.angle_deg),
        "heldout_px": rounded(held_out_px(material.chosen.heldout, count)),
    }
    if "stamp_ns" in columns:
        first = min(columns["stamp_ns"])
        columns["seconds"] = rounded(np.array([stamp - first for stamp in columns["stamp_ns"]]) * 1e-9)
        # Beyond what numbers of a browser hold exactly.
        columns["stamp_ns"] = [str(stamp) for stamp in columns["stamp_ns"]]
    return columns


def _models(material: Material) -> Json:
    """By model: errors of each pair, and stated deviations over the ground and the image."""
    documents: Json = {}
    count = len(material.pairs["x"])
    for model in material.models:
        errors = pair_errors(model.result, model.problem.points, model.problem.pixels)
        heldout_px = held_out_px(model.heldout, count)
        measured = np.where(np.isfinite(heldout_px), heldout_px, errors.distance_px)
        documents[model.result.model] = {
            "status": model.result.status,
            "mean_px": model.result.polished.mean_px,
            "rms_px": model.result.polished.rms_px,
            "measured_px": measured,
            "measured_on": "held-out pairs" if np.isfinite(heldout_px).any() else "fitted pairs",
            "ground": ground_map(model, material.pairs),
            "image": image_map(model, material.pairs),
        }
    return documents


def _slots(material: Material) -> Json:
    rows = np.array(material.slots, np.float64).reshape(-1, 3)
    return {"iteration": rows[:, 0].astype(int), "slot": rows[:, 1].astype(int), "loss_px": rows[:, 2]}


def _people(material: Material, errors: PairErrors) -> list[Json]:
    """Each person's marks: number of the pair, mark minus projection, its mean and RMS."""
    by_person: dict[str, list[tuple[int, float, float]]] = defaultdict(list)
    for mark in material.marks:
        u, v = errors.projected[mark.pair]
        if np.isfinite(u):
            by_person[mark.person].append((mark.pair, mark.u - float(u), mark.v - float(v)))
    return [{"name": person} | _of_person(np.array(rows)) for person, rows in sorted(by_person.items())]


def _of_person(rows: NDArray[np.float64]) -> Json:
    distance = np.hypot(rows[:, 1], rows[:, 2])
    return {
        "pair": rows[:, 0].astype(int),
        "off_u": rows[:, 1],
        "off_v": rows[:, 2],
        "mean_u": rows[:, 1].mean(),
        "mean_v": rows[:, 2].mean(),
        "rms_px": np.sqrt(np.mean(distance**2)),
    }
