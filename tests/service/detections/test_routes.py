"""Detections over HTTP, on both databases."""

import pytest

from apexcal.documents.detectors import DETECTORS
from service.platform.db.clock import now
from service.platform.db.detections import Detection, Vertex, VertexFrame
from service.platform.db.jobs import Job, Worker
from service.platform.db.recordings import Recording
from tests.service.detections.seeding import seed_marking, seed_recording, seed_rig

REGION = {"all": [{"quantity": "x", "op": ">", "value": 0}, {"quantity": "range", "op": "<", "value": 30}]}


def test_a_detection_is_stored_with_all_its_options_and_its_jobs(make_api):
    api = make_api()
    with api.database.writing() as session:
        times = {"started_at": now(), "at": now()}
        session.add(Worker(name="w", queues="detect", processes=4, version="1", warm=True, **times))
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    recording, _ = seed_recording(api.database, seed_rig(api.database, fleet), 1000)
    body = {"region": REGION, "detector": "tolerant", "options": {"min_points": 5}, "pairing": {"offset_ns": -7}}
    answer = engineer.post(f"/recordings/{recording}/detections", body)
    assert answer.status_code == 202
    found = answer.json()
    assert found["options"] == {
        "min_points": 5, "max_top_points": 3, "max_spread_m": 0.05, "min_points_two_below": 3
    }  # fmt: skip
    assert found["pairing"] == {"mode": "auto", "offset_ns": -7, "max_gap_ns": 50_000_000}
    assert found["state"] == "queued"
    assert found["job"]["kind"] == "detect"
    with api.database.reading() as session:
        row = session.query(Detection).one()
        payloads = [job.payload for job in session.query(Job).filter_by(subject_id=row.id).order_by(Job.id)]
    assert row.remaining == len(payloads) == 3
    covered = [sweep for part in payloads for sweep in range(part["first"], part["stop"])]
    assert covered == list(range(1000))
    assert engineer.get(f"/detections/{found['id']}").json() == found
    listed = engineer.get(f"/recordings/{recording}/detections").json()
    assert (listed["items"], listed["next"]) == ([found], None)
    assert found["reasons"] == {}


def test_reasons_of_refused_sweeps_are_said_in_sentences(api, fleet, engineer):
    recording, _ = seed_recording(api.database, seed_rig(api.database, fleet), 10)
    body = {"region": REGION, "detector": "refined"}
    made = engineer.post(f"/recordings/{recording}/detections", body).json()
    with api.database.writing() as session:
        session.query(Detection).one().counts = {"sweeps": 10, "rejected": {"never_shown": 4, "of_old": 6}}
    found = engineer.get(f"/detections/{made['id']}").json()
    assert found["reasons"] == {"never_shown": DETECTORS["refined"].reasons["never_shown"]}


def test_up_is_as_the_rig_states_it_unless_the_request_does(api, fleet, engineer):
    mount = {
        "from_frame": "lidar", "to_frame": "vehicle", "translation_m": [0.0, 0.0, 1.8],
        "rotation": {"quaternion_xyzw": [1.0, 0.0, 0.0, 0.0]},
    }  # fmt: skip
    recording, _ = seed_recording(api.database, seed_rig(api.database, fleet, T_vehicle_lidar=mount), 1000)

    def up(**body):
        answer = engineer.post(f"/recordings/{recording}/detections", {"region": REGION, **body})
        assert answer.status_code == 202
        return [answer.json()["options"].get(name) for name in ("up_x", "up_y", "up_z")]

    assert up() == [0.0, 0.0, -1.0]
    assert up(options={"up_y": 0.5, "up_z": 0.8}) == [0.0, 0.5, 0.8]
    assert up(detector="tolerant") == [None, None, None]


@pytest.mark.parametrize(
    ("change", "code", "says"),
    [
        ({"detector": "best"}, "unknown_detector", "strict, tolerant, refined"),
        ({"options": {"min_pionts": 5}}, "invalid_options", "min_pionts"),
        ({"options": {"max_spread_m": -1}}, "invalid_options", "max_spread_m"),
        ({"options": {"min_points": True}}, "invalid_options", "min_points"),
        ({"region": {"all": [{"quantity": "q", "op": ">", "value": 1}]}}, "invalid_request", "$.all[0].quantity"),
        ({"region": {"all": [{"quantity": "x", "op": "==", "value": 1}]}}, "invalid_request", "$.all[0].op"),
        ({"pairing": {"mode": "spline"}}, "invalid_request", "pairing.mode"),
        ({"pairing": {"max_gap_ns": -1}}, "invalid_request", "pairing.max_gap_ns"),
        ({"regoin": 1}, "invalid_request", "regoin"),
    ],
)
def test_bad_requests_are_named_and_nothing_is_stored(api, fleet, engineer, change, code, says):
    recording, _ = seed_recording(api.database, seed_rig(api.database, fleet), 10)
    answer = engineer.post(f"/recordings/{recording}/detections", {"region": REGION, **change})
    problem = answer.json()
    assert (answer.status_code, problem["code"]) == (422, code)
    assert says in problem["detail"] + problem["hint"]
    with api.database.reading() as session:
        assert session.query(Detection).count() == session.query(Job).count() == 0


def test_a_recording_that_is_not_ready_is_refused_with_what_to_do(api, fleet, engineer):
    recording, _ = seed_recording(api.database, seed_rig(api.database, fleet), 10)
    for state in ("ingesting", "failed"):
        with api.database.writing() as session:
            session.get_one(Recording, recording).state = state
        answer = engineer.post(f"/recordings/{recording}/detections", {"region": REGION})
        assert (answer.status_code, answer.json()["code"]) == (409, "recording_not_ready")
        assert answer.json()["hint"]


def test_cancelling_asks_every_job_of_the_detection_to_end(api, fleet, engineer):
    recording, _ = seed_recording(api.database, seed_rig(api.database, fleet), 10)
    found = engineer.post(f"/recordings/{recording}/detections", {"region": REGION}).json()
    assert engineer.post(f"/detections/{found['id']}/cancel").status_code == 202
    with api.database.reading() as session:
        assert all(job.cancel_requested for job in session.query(Job))


def test_vertices_come_in_pages_with_their_frames(api, fleet, viewer):
    seed = seed_marking(api.database, fleet, vertices=5)
    pages, after = [], ""
    while True:
        page = viewer.get(f"/detections/{seed.detection_id}/vertices/details?camera=front&limit=2{after}").json()
        pages += page["items"]
        if page["next"] is None:
            break
        after = f"&after={page['next']}"
    assert [item["id"] for item in pages] == [str(one) for one in seed.vertices]
    assert pages[3]["frames"] == {"front": {"index": 3, "gap_ns": 3, "moved": None, "corners": []}}
    assert (pages[3]["x"], pages[3]["ring"], pages[3]["points"]) == (8.0, 7, 2)
    assert (pages[3]["quality"], pages[3]["flags"], pages[3]["covariance"]) == (None, [], None)
    assert viewer.get(f"/detections/{seed.detection_id}/vertices/details").json()["items"] == pages
    unknown = viewer.get(f"/detections/{seed.detection_id}/vertices/details?camera=rear")
    assert (unknown.status_code, unknown.json()["code"], unknown.json()["cameras"]) == (
        404,
        "unknown_camera",
        ["front"],
    )


def test_vertices_say_how_sure_they_are_and_what_to_look_at(api, fleet, viewer):
    seed = seed_marking(api.database, fleet, vertices=3)
    covariance = [[1e-7, 0.0, 0.0], [0.0, 2e-7, 0.0], [0.0, 0.0, 1e-4]]
    with api.database.writing() as session:
        vertex = session.get_one(Vertex, seed.vertices[1])
        vertex.quality, vertex.flags, vertex.covariance = "fine", ["head_above"], covariance
        frame = session.get_one(VertexFrame, (vertex.id, seed.camera_id))
        frame.x, frame.y, frame.z, frame.covariance, frame.gap_ns = 6.5, 0.2, 0.5, covariance, 0
    path = f"/detections/{seed.detection_id}/vertices/details"
    (fine,) = viewer.get(path, params={"quality": "fine"}).json()["items"]
    assert (fine["id"], fine["quality"], fine["covariance"]) == (str(seed.vertices[1]), "fine", covariance)
    assert [flag["name"] for flag in fine["flags"]] == ["head_above"] and "board" in fine["flags"][0]["sentence"]
    moved = {"x": 6.5, "y": 0.2, "z": 0.5, "covariance": covariance}
    assert fine["frames"] == {"front": {"index": 1, "gap_ns": 0, "moved": moved, "corners": []}}
    assert viewer.get(path, params={"quality": "usable"}).json()["items"] == []
    assert viewer.get(path, params={"quality": "good"}).status_code == 422
