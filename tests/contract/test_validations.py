"""What workers write of a validation is what its documents say, and what plain NumPy computes."""

import numpy as np
import pytest

from apexcal.documents.validations import PairScore
from tests.service.detections.seeding import LEVEL, seed_rig
from tests.support.work import work

F, CX, CY = 420.0, 325.0, 236.0
LENS = {"model": "pinhole", "parameters": {"f_x": F, "f_y": F, "c_x": CX, "c_y": CY}, "image_size": [640, 480]}


def errors_of(points, marks):
    """Distances, px, under the level mount of the seeded rig."""
    right, down, forward = -points[:, 1], -points[:, 2] - 0.1, points[:, 0] - 0.2
    return np.hypot(F * right / forward + CX - marks[:, 0], F * down / forward + CY - marks[:, 1])


@pytest.mark.usefixtures("broker")
def test_a_calibration_is_scored_on_pairs_that_it_never_saw(api, context):
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    rig = seed_rig(api.database, fleet)
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(5, 20, 40), rng.uniform(-2, 2, 40), rng.uniform(-1, 1, 40)])
    marks = rng.uniform(100, 400, (40, 2))
    pairs = [dict(zip("xyzuv", row, strict=True)) for row in np.hstack([points, marks]).tolist()]
    made = engineer.post(f"/rigs/{rig.id}/correspondence-sets", {"pairs": pairs}, params={"camera": "front"}).json()
    body = {"kind": "pairs", "camera": "front", "set_id": made["id"]}
    body["calibration"] = {"lens": LENS, "transform": LEVEL}
    asked = engineer.post(f"/vehicles/{rig.vehicle_id}/validations", body)
    assert asked.status_code == 202, asked.text
    work(context)
    done = engineer.get(f"/validations/{asked.json()['id']}").json()
    assert (done["state"], done["problem"]) == ("done", None)
    score = PairScore.model_validate(done["result"])
    assert not score.model_extra
    errors = errors_of(points, marks)
    assert (score.mean_px, score.max_px) == (pytest.approx(errors.mean()), pytest.approx(errors.max()))
    assert score.verdict == "unknown" and "states no deviations" in score.sentence
