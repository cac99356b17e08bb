"""Remedies from the request to the answer: tried by a worker on the result's own pairs."""

import pytest

from apexcal.documents.remedies import RemediesView
from tests.contract.test_work import SCHEDULE, pairs_of_a_pinhole
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.work import work


@pytest.mark.parametrize(("off_px", "advice"), [(60.0, "wrong_pairs"), (0.0, None)])
def test_wrong_marks_are_left_out_and_held_out_pairs_say_what_that_brings(context, engineer, rig, off_px, advice):
    pairs = pairs_of_a_pinhole()
    for pair in pairs[::8]:
        pair["v"] += off_px
    body = {"models": ["pinhole"], "folds": 2, "schedule": SCHEDULE, "loss": "mean", "outliers": "keep"}
    asked = ask_calibration(engineer, rig.vehicle_id, bring_pairs(engineer, rig.id, pairs), **body)
    work(context)
    done = engineer.get(f"/calibrations/{asked}").json()
    result = done["summary"]["cameras"]["front"]["models"]["pinhole"]["result_id"]
    trial = engineer.post("/analyses", {"kind": "remedies", "result_id": result}).json()["id"]
    work(context)
    view = RemediesView.model_validate_json(engineer.get(f"/analyses/{trial}").content, extra="forbid")
    assert (view.state, view.problem) == ("done", None)
    assert view.result.advice == advice, view.result
    said = [one for one in view.result.trials if one.check == "wrong_pairs"]
    assert len(said) == (advice is not None)
    for one in said:
        assert one.outcome == "helps" and one.noise_px < one.noise_before_px and one.log_likelihood > 4.0
        assert "Without the wrong marks the result is better: held-out pairs scatter by" in one.sentence
