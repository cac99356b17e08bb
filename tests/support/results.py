"""Whole results and summaries as the database keeps them, of which a test changes what it is about."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any
from uuid import UUID

import numpy as np

from apexcal.documents.results import FitResult
from apexcal.documents.summaries import ModelSummary, RigSummary, SharedVertices, Summary
from apexcal.geometry.se3 import SE3, to_document

Json = dict[str, Any]
LEVEL = SE3("camera", "velodyne", np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]))
"""A mount that looks ahead."""
FREE = {"pinhole": 10, "brown_conrady": 16, "kannala_brandt": 14}


ENDED = {"minimised": "mean pixel distance", "parameters": {}, "converged": True, "message": "Converged."}
"""A stage of a fit but for its errors."""


def fit_result(model: str = "pinhole", mean_px: float = 0.5, **members: Any) -> Json:
    """The document of a fit to 20 pairs without stated deviations."""
    errors = {"mean_px": mean_px, "rms_px": mean_px}
    ended = ENDED | errors
    search = {"minimised": "mean pixel distance", "parameters": {}, "loss_px": mean_px} | errors
    document = {
        "model": model, "search": "rotation_vector", "status": "ok", "message": "Stopped.", "loss": "mean",
        "weights": "equal", "pairs": 20, "free_parameters": FREE[model], "iterations": 1, "stopped": "converged",
        "evaluations": 100, "history": [mean_px], "ga": search, "polished": ended,
        "baseline": ended, "linear_baseline": None, "kept": {"pairs": 20} | errors,
        "outliers": [], "parameters": {}, "lens": "fitted", "stated_lens": None, "residuals_px": [mean_px] * 20,
        "intrinsics": {
            "model": model, "f_x": 600.0, "f_y": 600.0, "c_x": 640.0, "c_y": 480.0, "image_size": [1280, 960],
        },
        "transform": to_document(LEVEL), "at_bounds": [], "checks": [], "several_optima": [], "shared_errors": None,
        "common_errors": {}, "person_bias": None, "line_time_us": 0.0, "rolling_shutter": None, "weak_priors": {},
        "clock_offset": None, "halves": [], "prediction": None, "next_steps": None, "explained_px": None,
        "marks_outside": None, "field": None, "heldout": None, "cpu": {}, "versions": {},
        "provenance": None, "finish_seconds": None, "std": {}, "interval95_half_width": {},
        "covariance": {"names": [], "units": [], "matrix": []}, "sigma_px": mean_px, "correlation": [],
        "worst_correlation": None, "noise_scale": None, "rank": FREE[model], "condition": 1.0, "undetermined": [],
        "degrees_of_freedom": None,
    } | members  # fmt: skip
    FitResult.model_validate(document)
    return document


def of_block(errors: Sequence[float], rows: Iterable[int]) -> Json:
    """The errors of held-out pairs of one block, each a standard one."""
    errors, indices = list(errors), list(rows)
    single = {"errors_px": errors, "standard_px": errors, "stretch": [1.0] * len(errors), "indices": indices}
    over_all = {"mean_px": 1.0, "rms_px": 1.0, "max_px": max(errors), "forbidden": 0}
    return single | over_all | {"blocks": indices[:1] * len(indices)}


def half(split: str, **members: Any) -> Json:
    """The comparison of two halves that agree."""
    measured = (
        "ratio",
        "limit",
        "rotation_deg",
        "translation_mm",
        "field_px",
        "stated_px",
        "field_ratio",
        "field_limit",
    )
    turned = dict.fromkeys(("turned_deg", "turned_ratio", "turned_limit"))
    return {"split": split, "pairs": [10, 10], "holds": True} | dict.fromkeys(measured, 1.0) | turned | members


def model_summary(result_id: UUID, result: Json | None = None, **members: Any) -> Json:
    """What a calibration's end says of a model, by default of one without held-out pairs."""
    of = result or fit_result()
    known = {name: of[name] for name in ModelSummary.model_fields if name in of}
    none = dict.fromkeys(
        ("stated_lens", "heldout_mean_px", "heldout_rms_px", "heldout_sigma_px", "weight", "between_models", "behind")
    )
    counted = {"heldout_pairs": 0, "heldout_forbidden": 0, "seconds": 1.0, "workers": ["w"]}
    judged = {"result_id": str(result_id), "verdict": "pass", "verdict_alone": "pass"}
    return ModelSummary.model_validate(known | none | counted | judged | members).model_dump(mode="json")


def summary(models: dict[str, Json], camera: str = "front", rig: Json | None = None, **members: Any) -> Json:
    """A calibration's summary of one camera, which recommends its first model."""
    of_camera = {"recommended": next(iter(models)), "why": "", "models": models, "checks": [], "published": None}
    whole = {"cameras": {camera: of_camera | members}, "rig": rig}
    return Summary.model_validate(whole).model_dump(mode="json")


def rig_summary(odd: list[Json]) -> Json:
    """Two cameras compared that put these vertices apart."""
    shared = dict.fromkeys(SharedVertices.model_fields, 1) | {"offset_px": [0.0, 0.0], "odd": odd}
    nothing = dict.fromkeys(("transform", "std", "interval95_half_width"))
    pair = {"cameras": ["front", "left"], "models": ["pinhole"] * 2, "name": "T_front_left", "shared": shared}
    pair |= nothing | {"stated": [], "sentences": [], "alarms": []}
    return RigSummary.model_validate({"pairs": [pair], "alarms": [], "left_out": [], "problem": None}).model_dump()
