"""Which calibration is validated, and who sees single pairs, on both databases."""

import pytest

from apexcal.documents.validations import SINGLE_PAIRS
from service.platform.db.analyses import Analysis
from service.platform.db.calibrations import Calibration, CorrespondenceSet, Result
from service.platform.db.fleets import Vehicle
from tests.service.analyses.test_kinds import LENS, STATED
from tests.service.calibrations.test_results import seed_results
from tests.service.detections.seeding import seed_recording
from tests.support.asking import bring_pairs

PAIRS = [{"x": 9.0, "y": 0.1 * i, "z": 0.2, "u": 300.0 + i, "v": 200.0, "group": i // 4} for i in range(12)]
SCORE = {"verdict": "agrees", "sentence": "It holds.", "pairs": 1, "forbidden": 0, "wrong": 0, "mean_px": 1.0}
COLUMNS = {"u": [1.0], "v": [2.0], "residual_u": [0.5], "residual_v": [None], "is_wrong": [False]}


@pytest.fixture
def body(engineer, rig):
    """A request to score the current calibration on pairs that were brought."""
    return {"kind": "pair_validation", "set_id": bring_pairs(engineer, rig.id, PAIRS)}


@pytest.mark.parametrize("source", ["import", "annotations"])
def test_single_pairs_are_read_alone_and_those_of_marks_by_reviewers(api, fleet, engineer, body, source):
    asked = engineer.post("/analyses", body | {"calibration": STATED}).json()
    with api.database.writing() as session:
        row = session.query(Analysis).one()
        assert row.asked["calibration"]["intrinsics"]["f_x"] == 400
        row.state, row.result, row.single_pairs = "done", SCORE, COLUMNS
        session.query(CorrespondenceSet).one().source = source
    assert set(COLUMNS) == set(SINGLE_PAIRS)
    address, annotator = f"/analyses/{asked['id']}", api.member(fleet, "annotator")
    (listed,) = engineer.get("/analyses").json()["items"]
    assert listed["result"] == SCORE
    assert engineer.get(address).json()["result"] == SCORE | COLUMNS
    assert annotator.get(address).json()["result"] == SCORE | (COLUMNS if source == "import" else {})


def with_lens(**changes):
    return {"calibration": STATED | {"lens": LENS | changes}}


def test_what_does_not_belong_together_is_refused(api, engineer, rig, body):
    recording, _ = seed_recording(api.database, rig, 3)
    _, (result, _) = seed_results(api, rig)
    lanes = {"kind": "lane_validation", "camera": "front", "recording_id": str(recording)}
    stated, tested = {"calibration": STATED}, {"result_id": str(result)}
    for wrong, status, code in (
        (lanes, 404, "no_calibration"),
        (lanes | stated | {"camera": "rear"}, 404, "unknown_camera"),
        (lanes | stated | tested, 422, "invalid_request"),
        (body | stated | {"camera": "front"}, 422, "invalid_request"),
        (body | with_lens(distortion_model="strange"), 422, "unknown_distortion_model"),
        (body | with_lens(K=[0.0] * 9), 422, "invalid_intrinsics"),
    ):
        refused = engineer.post("/analyses", wrong)
        assert (refused.status_code, refused.json()["code"]) == (status, code), refused.text
    with api.database.writing() as session:
        session.get_one(Result, result).camera = "rear"
    for request in (lanes, body):
        refused = engineer.post("/analyses", request | tested)
        assert (refused.status_code, refused.json()["code"]) == (422, "result_of_another_camera")
    with api.database.writing() as session:
        other = Vehicle(fleet_id=rig.fleet_id, name="another")
        session.add(other)
        session.flush()
        session.query(Calibration).one().vehicle_id = other.id
    for request in (lanes, body):
        refused = engineer.post("/analyses", request | tested)
        assert (refused.status_code, refused.json()["code"]) == (422, "result_of_another_vehicle")
