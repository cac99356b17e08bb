"""A row's JSON goes out as it lies there, whatever version wrote it; who reads the answer gets it as its type."""

import json
from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from apexcal.documents.base import Stored
from apexcal.documents.results import ResultView
from apexcal.documents.summaries import Summary

PLAIN = TypeAdapter(dict[str, Any])
RESULT = TypeAdapter(Stored[ResultView])
ID = "0192f0c1-2d3e-7a4b-8c5d-6e7f8a9b0c1d"
ERRORS = {"mean_px": 1, "rms_px": 1.5, "minimised": "distance", "converged": True, "message": "", "parameters": {}}
ROTATION = {"matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "quaternion_xyzw": [0, 0, 0, 1], "euler": []}
OLD: dict[str, Any] = {
    "of_another_version": {"kept": [1, 2.0, None]},
    "model": "pinhole",
    "status": "ok",
    "message": "",
    "polished": ERRORS | {"also_kept": 1e-7},
    "transform": {"to_frame": "c", "from_frame": "l", "rotation": ROTATION, "translation_m": [0, 0, 1]},
    "intrinsics": {"image_size": [640, 480], "model": "pinhole", "f_x": 500, "f_y": 500.0, "c_x": 320, "c_y": 240},
    "search": "rotation_vector",
    "loss": "mean",
    "weights": "equal",
    "lens": "fitted",
    "line_time_us": 0.0,
    **dict.fromkeys(("pairs", "free_parameters", "iterations", "evaluations", "rank", "sigma_px"), 1),
    "ga": ERRORS | {"loss_px": 1.0},
    "kept": {"pairs": 3, "mean_px": 1, "rms_px": 1.5},
    "covariance": {"names": [], "units": [], "matrix": []},
    **{
        name: {}
        for name in ("parameters", "interval95_half_width", "common_errors", "weak_priors", "cpu", "versions")
    },
    **{name: [] for name in ("history", "outliers", "at_bounds", "checks", "several_optima", "halves")},
    **{name: [] for name in ("correlation", "undetermined")},
    **dict.fromkeys(("baseline", "linear_baseline", "stated_lens", "shared_errors", "person_bias", "heldout")),
    **dict.fromkeys(
        ("clock_offset", "rolling_shutter", "prediction", "explained_px", "marks_outside", "field", "provenance")
    ),
    **dict.fromkeys(("next_steps", "finish_seconds", "stopped", "worst_correlation", "noise_scale", "condition")),
    **dict.fromkeys(("degrees_of_freedom", "recording_id", "detection_id", "seed", "verdict", "verdict_alone")),
    "std": {"f_x": None},
    "residuals_px": [0.1, 2, 3e-12],
    **dict.fromkeys(("id", "fleet_id", "vehicle_id", "rig_id", "calibration_id", "run_id", "set_id"), ID),
    "camera": "front",
    "fold": -1,
    "created_at": "2026-01-01T00:00:00Z",
}


def test_a_result_of_an_older_version_goes_out_byte_for_byte():
    sent = RESULT.dump_json(RESULT.validate_python(OLD))
    assert sent == PLAIN.dump_json(OLD)
    assert json.loads(sent) == OLD


def test_who_reads_it_gets_its_type_and_what_it_does_not_know():
    read = ResultView.model_validate_json(json.dumps(OLD), extra="allow")
    assert (read.intrinsics.f_x, read.polished.rms_px, read.heldout) == (500.0, 1.5, None)
    assert read.model_dump(mode="json", exclude_unset=True) == OLD


def test_a_wrong_document_is_found_where_it_is_read():
    with pytest.raises(ValidationError, match="to_frame"):
        ResultView.model_validate_json(json.dumps(OLD | {"transform": {}}))
    with pytest.raises(ValidationError, match="not permitted"):
        ResultView.model_validate_json(json.dumps(OLD), extra="forbid")


def test_the_description_is_that_of_the_type():
    described = TypeAdapter(Stored[Summary]).json_schema(mode="serialization")
    assert "cameras" in described["properties"] and "ModelSummary" in described["$defs"]
