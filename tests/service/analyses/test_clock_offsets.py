"""Clock offsets over HTTP, on both databases."""

from service.platform.db.analyses import Analysis
from service.platform.db.detections import Detection
from service.platform.db.jobs import Job
from service.platform.settings import get_settings
from tests.service.detections.seeding import seed_answer, seed_marking

FOUND = {"offset_ns": -30_200_000, "sigma_ns": 1_100_000, "rms_px": 1.4, "pairs": 3}


def answer_with(api, result):
    with api.database.writing() as session:
        row = session.query(Analysis).one()
        row.state, row.result = "done", result


def test_a_clock_offset_starts_from_the_marks_with_their_frames_own_stamps(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=5)
    body = {"kind": "clock_offset", "detection_id": str(seed.detection_id), "camera": "front"}
    path = "/analyses"
    nothing = engineer.post(path, body)
    assert (nothing.status_code, nothing.json()["code"]) == (409, "nothing_marked")
    for number in (1, 3):
        seed_answer(api.database, seed, engineer.person_id, number, "confirmed", (10.0 * number, 20.0))
    seed_answer(api.database, seed, engineer.person_id, 4, "rejected", None)
    asked = engineer.post(path, body)
    assert asked.status_code == 202, asked.text
    made = asked.json()
    assert (made["marks"], made["camera"], made["hint"], made["job"]["kind"]) == (2, "front", None, "clock_offset")
    with api.database.reading() as session:
        row = session.query(Analysis).one()
        assert row.asked["marks"] == {"stamp_ns": [100_000_000, 300_000_000], "u": [10.0, 30.0], "v": [20.0, 20.0]}
        assert row.asked["fit_request"]["image_size"] == [640, 480]
    answer_with(api, FOUND)
    read = engineer.get(f"/analyses/{made['id']}").json()
    assert read["result"] == FOUND
    assert "30.2 ms behind" in read["hint"] and "pairing.offset_ns = -30200000" in read["hint"]
    assert "make a detection for each" in read["hint"]
    answer_with(api, FOUND | {"offset_ns": 2_000_000})
    assert "agree within the error" in engineer.get(f"/analyses/{made['id']}").json()["hint"]


def test_a_clock_offset_that_cannot_be_asked_is_refused(api, fleet, engineer):
    seed = seed_marking(api.database, fleet)
    seed_answer(api.database, seed, engineer.person_id, 1, "confirmed", (10.0, 20.0))
    path = "/analyses"
    known = {"kind": "clock_offset", "detection_id": str(seed.detection_id), "camera": "front"}
    for change, status, code in (
        ({"camera": "rear"}, 404, "unknown_camera"),
        ({"model": "fisheye"}, 422, "unknown_model"),
    ):
        refused = engineer.post(path, known | change)
        assert (refused.status_code, refused.json()["code"]) == (status, code)
    for state, hint in (("running", "Wait"), ("failed", "Run")):
        with api.database.writing() as session:
            session.get_one(Detection, seed.detection_id).state = state
        refused = engineer.post(path, known)
        assert (refused.status_code, refused.json()["code"]) == (409, "detection_not_done")
        assert refused.json()["state"] == state and hint in refused.json()["hint"]
    with api.database.reading() as session:
        assert session.query(Analysis).count() == session.query(Job).count() == 0


def test_a_clock_offset_of_too_many_marks_is_refused(api, fleet, engineer, monkeypatch):
    seed = seed_marking(api.database, fleet, vertices=20)
    for number in range(20):
        seed_answer(api.database, seed, engineer.person_id, number, "confirmed", (10.0 + number, 20.0))
    # A time limit under which twenty are too many.
    monkeypatch.setenv("APEXCAL_TASK_LIMIT_S", "1")
    get_settings.cache_clear()
    refused = engineer.post(
        "/analyses", {"kind": "clock_offset", "detection_id": str(seed.detection_id), "camera": "front"}
    )
    assert (refused.status_code, refused.json()["code"]) == (422, "work_too_long")
    assert "20 marks" in refused.json()["detail"]
    with api.database.reading() as session:
        assert session.query(Analysis).count() == session.query(Job).count() == 0
