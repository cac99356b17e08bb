"""Correspondence sets: made of marks with everything said that was left out, imported, immutable, each once."""

from uuid import UUID

import pytest
from sqlalchemy import select

from apexcal.documents.states import WorkState
from service.calibrations.pair_rules import common_errors
from service.platform.db.analyses import Analysis
from service.platform.db.calibrations import CorrespondenceSet
from service.platform.db.detections import Detection, VertexFrame
from service.platform.db.recordings import Recording, Sensor
from tests.service.detections.seeding import (
    Seed,
    seed_answer,
    seed_apexes,
    seed_detection,
    seed_marking,
    seed_recording,
    vertices_of,
)
from tests.support.places import BOARD

CSV = {"Content-Type": "text/csv"}
ROWS = "x,y,z,u,v,pose\n4,0,0.5,320.5,200,1\n5,1,0.5,200,210,2\n"


def build(engineer, seed, **body):
    return engineer.post(f"/detections/{seed.detection_id}/correspondence-sets", {"camera": "front", **body})


def say(api, seed, person, *said):
    for number, (verdict, mark) in enumerate(said):
        if verdict:
            seed_answer(api.database, seed, person.person_id, number, verdict, mark)


def test_marks_become_pairs_and_what_did_not_is_said(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=6, marks_per_vertex=3)
    one, two, three = (api.member(fleet, "annotator", name) for name in ("one", "two", "three"))
    say(api, seed, one, *[("confirmed", (100.0, 50.0))] * 3, ("rejected", None), ("unsure", None))
    say(
        api,
        seed,
        two,
        ("confirmed", (102.0, 50.0)),
        ("confirmed", (100.0, 54.0)),
        ("rejected", None),
        ("rejected", None),
    )
    say(api, seed, three, ("confirmed", (101.0, 50.0)), (None, None), (None, None), ("confirmed", (1.0, 1.0)))
    answer = build(engineer, seed)
    assert answer.status_code == 201
    made = answer.json()
    assert (made["count"], made["source"], made["flagged"], made["camera"]) == (3, "annotations", 1, "front")
    assert made["notes"] == [
        "1 of 6 corners are not marked, and left out.",
        "3 of 6 corners have fewer than the 3 independent marks asked for.",
        "1 of 6 corners are left out, because most people rejected them.",
        "1 of 6 corners have as many rejections as confirmations, and are kept and flagged.",
        "1 of 6 corners are left out, because people were unsure of them.",
    ]
    pairs = engineer.get(f"/correspondence-sets/{made['id']}").json()["pairs"]
    assert [(pair["u"], pair["v"], pair["marks"], pair["flagged"]) for pair in pairs] == [
        (101.0, 50.0, 3, False),
        (100.0, 52.0, 2, False),
        (100.0, 50.0, 1, True),
    ]
    assert (pairs[1]["spread_px"], pairs[1]["stamp_ns"], pairs[1]["gap_ns"]) == (2.0, 100_000_000, 1)
    markers = [set(pair["marked_by"]) for pair in pairs]
    assert [len(one) for one in markers] == [3, 2, 1] and markers[0] == {0, 1, 2}
    assert markers[2] < markers[1] < markers[0], "one marked all three, two marked the first two"
    assert "sigma_clock_ms" not in pairs[0] or pairs[0]["sigma_clock_ms"] is None
    strict = build(engineer, seed, exclude_flagged=True).json()
    assert (strict["count"], strict["flagged"]) == (2, 0)
    assert "and are left out" in strict["notes"][3]


def test_pairs_state_the_deviation_of_the_clock_offset_that_they_were_made_with(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=2)
    say(api, seed, engineer, *[("confirmed", (1.0, 2.0))] * 2)
    with api.database.writing() as session:
        detection = session.get_one(Detection, seed.detection_id)
        detection.pairing = {**detection.pairing, "offset_ns": -30_200_000}
        common = {"fleet_id": detection.fleet_id, "vehicle_id": seed.vehicle_id, "recording_id": seed.recording_id}
        for camera, offset_ns, sigma_ns in (
            ("front", -30_200_000, 1_100_000),
            ("rear", -30_200_000, 7),
            ("front", 5, 8),
        ):
            found = {"asked": {"camera": camera}, "result": {"offset_ns": offset_ns, "sigma_ns": sigma_ns}}
            session.add(Analysis(**common, kind="clock_offset", state=WorkState.DONE, **found))
    made = build(engineer, seed).json()
    pairs = engineer.get(f"/correspondence-sets/{made['id']}").json()["pairs"]
    assert [pair["sigma_clock_ms"] for pair in pairs] == [1.1, 1.1]
    with api.database.reading() as session:
        stated = common_errors(session.get_one(CorrespondenceSet, UUID(made["id"])), {})
    board = {"tip_across_mm": 3.5, "tip_up_mm": 5.8, "range_mm": 17.3}
    assert stated == {"elevation_deg": 0.1, "person_px": 1.0, "clock_ms": 1.1, **board}
    with api.database.writing() as session:
        session.get_one(Detection, seed.detection_id).options = {"upper_corner": 1}
    with api.database.reading() as session:
        upper = common_errors(session.get_one(CorrespondenceSet, UUID(made["id"])), {})
    assert upper == stated | {"tip_across_mm": 4.8, "tip_up_mm": 4.8}


def test_the_machine_counts_as_one_more_person_and_what_it_marked_alone_is_said(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=4)
    say(api, seed, engineer, ("confirmed", (100.0, 50.0)), ("confirmed", (100.0, 50.0)))
    marks = {
        "vertex_id": [str(vertex) for vertex in seed.vertices[1:]], "corner": ["top"] * 3,
        "u": [102.0, 60.0, None], "v": [50.0, 61.0, None], "sigma_u": [0.3, 0.3, None], "sigma_v": [0.4, 0.5, None],
        "edge_px": [60.0, 60.0, None], "reason": [None, None, "no_edge"],
    }  # fmt: skip
    with api.database.writing() as session:
        of = {"fleet_id": fleet, "vehicle_id": seed.vehicle_id, "recording_id": seed.recording_id}
        of |= {"detection_id": seed.detection_id, "kind": "machine_marks", "state": WorkState.DONE}
        session.add(Analysis(**of, asked={"camera": "front"}, result={"marks": marks}))
        session.add(Analysis(**of, asked={"camera": "rear"}, result={"marks": marks | {"u": [1.0, 1.0, None]}}))
    assert build(engineer, seed).json()["count"] == 2
    made = build(engineer, seed, machine_marks=True).json()
    assert made["notes"][-1] == "1 of 3 marks are the machine's."
    pairs = engineer.get(f"/correspondence-sets/{made['id']}").json()["pairs"]
    told = [(pair["u"], pair["v"], pair["marks"], pair["machine"]) for pair in pairs]
    assert told == [(100.0, 50.0, 1, False), (101.0, 50.0, 2, False), (60.0, 61.0, 1, True)]
    person, both, machine = (set(pair["marked_by"]) for pair in pairs)
    assert person | machine == both and not person & machine
    assert [pair["sigma_px"] for pair in pairs] == [None, None, pytest.approx((0.5 * (0.3**2 + 0.5**2)) ** 0.5)]
    assert [pair["machine_off_px"] for pair in pairs] == [None, [2.0, 0.0], None]
    assert "confirmed" not in pairs[0], "nobody saw a mark of the machine"


def test_a_moved_vertex_is_paired_where_it_was_at_the_frames_time_with_its_deviations(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=2)
    say(api, seed, api.member(fleet, "annotator"), *[("confirmed", (1.0, 2.0))] * 2)
    with api.database.writing() as session:
        for number, vertex_id in enumerate(seed.vertices):
            frame = session.get_one(VertexFrame, (vertex_id, seed.camera_id))
            frame.x, frame.y, frame.z, frame.gap_ns = 7.0 + number, 1.0, 0.5, 0
            frame.covariance = [[4e-8, 0.0, 0.0], [0.0, 1e-8, 0.0], [0.0, 0.0, 1e-4]]
    made = build(engineer, seed).json()
    pairs = engineer.get(f"/correspondence-sets/{made['id']}").json()["pairs"]
    assert [(pair["x"], pair["y"], pair["gap_ns"]) for pair in pairs] == [(7.0, 1.0, 0), (8.0, 1.0, 0)]
    sigmas = [pairs[0][f"sigma_{name}"] for name in ("azimuth_rad", "elevation_rad", "range_m")]
    assert sigmas == pytest.approx([2e-4, 1e-4, 1e-2])
    with api.database.writing() as session:
        session.get_one(VertexFrame, (seed.vertices[0], seed.camera_id)).x = None
    mixed = build(engineer, seed).json()
    pairs = engineer.get(f"/correspondence-sets/{mixed['id']}").json()["pairs"]
    assert pairs[0]["x"] == 5.0 and not any(name.startswith("sigma") for name in pairs[1])


def test_the_same_marks_give_the_same_set(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=2)
    person = api.member(fleet, "annotator")
    say(api, seed, person, ("confirmed", (1.0, 2.0)), ("confirmed", (3.0, 4.0)))
    first, again = build(engineer, seed), build(engineer, seed)
    assert (first.status_code, again.status_code) == (201, 200)
    assert again.json() == first.json()
    with api.database.reading() as session:
        assert session.query(CorrespondenceSet).count() == 1


def test_an_import_is_stored_once_and_read_back_as_it_was_brought(engineer, rig):
    address = f"/rigs/{rig.id}/correspondence-sets"
    made = engineer.post(address, params={"camera": "front"}, content=ROWS, headers=CSV)
    assert (made.status_code, made.json()["count"], made.json()["source"]) == (201, 2, "import")
    read = engineer.get(f"/correspondence-sets/{made.json()['id']}")
    assert read.json()["pairs"][0] == {"x": 4.0, "y": 0.0, "z": 0.5, "u": 320.5, "v": 200.0, "group": 1}
    again = engineer.post(address, {"pairs": read.json()["pairs"]}, params={"camera": "front"})
    assert (again.status_code, again.json()["id"]) == (200, made.json()["id"])
    unchanged = engineer.get(
        f"/correspondence-sets/{made.json()['id']}", headers={"If-None-Match": read.headers["etag"]}
    )
    assert unchanged.status_code == 304
    listed = engineer.get(address).json()["items"]
    assert listed == [made.json()]


def test_marks_outside_the_rigs_image_are_said(engineer, rig):
    rows = "x,y,z,u,v\n4,0,0.5,639.6,200\n5,1,0.5,200,210\n"
    made = engineer.post(f"/rigs/{rig.id}/correspondence-sets", params={"camera": "front"}, content=rows, headers=CSV)
    assert "1 pair lies outside the image of 640 x 480 pixels" in made.json()["notes"][0]


@pytest.mark.parametrize(
    ("body", "headers", "camera", "status", "code"),
    [
        (ROWS.replace("200,1", "two,1"), CSV, "front", 422, "invalid_pairs"),
        (ROWS.encode("utf-16"), CSV, "front", 422, "invalid_pairs"),
        (ROWS, {"Content-Type": "application/xml"}, "front", 415, "unsupported_media_type"),
        (ROWS, CSV, "rear", 404, "unknown_camera"),
        ("{}", {"Content-Type": "application/json"}, "front", 422, "invalid_pairs"),
    ],
)
def test_bad_imports_are_refused_and_nothing_is_stored(api, engineer, rig, body, headers, camera, status, code):
    answer = engineer.post(
        f"/rigs/{rig.id}/correspondence-sets", params={"camera": camera}, content=body, headers=headers
    )
    assert (answer.status_code, answer.json()["code"]) == (status, code)
    assert answer.json()["hint"]
    with api.database.reading() as session:
        assert session.query(CorrespondenceSet).count() == 0


REAL = BOARD / "correspondences.csv"


def test_two_recordings_with_the_same_marks_have_a_set_each(api, fleet, engineer, rig):
    made = []
    for _ in range(2):
        recording, camera = seed_recording(api.database, rig, 3)
        apexes = seed_apexes(api.database, recording, 2)
        detection = seed_detection(api.database, fleet, recording, apexes)
        found = vertices_of(api.database, detection)
        seed = Seed(fleet, rig.vehicle_id, rig.id, recording, camera, detection, found, apexes)
        say(api, seed, engineer, ("confirmed", (100.0, 50.0)), ("confirmed", (101.0, 50.0)))
        answer = build(engineer, seed)
        assert (answer.status_code, answer.json()["recording_id"]) == (201, str(recording))
        made.append(answer.json())
    assert engineer.delete(f"/recordings/{made[0]['recording_id']}").status_code == 204
    assert engineer.get(f"/correspondence-sets/{made[0]['id']}").status_code == 404
    assert engineer.get(f"/correspondence-sets/{made[1]['id']}").json()["count"] == 2


def test_what_is_said_of_a_set_is_never_of_another_time(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=1)
    say(api, seed, engineer, ("confirmed", (1.0, 2.0)))
    first = build(engineer, seed).json()
    with api.database.writing() as session:
        session.get_one(Recording, seed.recording_id).marks_per_vertex = 3
    second = build(engineer, seed)
    assert (second.status_code, first["notes"]) == (201, [])
    assert second.json()["notes"] == ["1 of 1 corners have fewer than the 3 independent marks asked for."]


def test_who_marks_does_not_read_the_pairs_made_of_marks(api, fleet, engineer, reviewer):
    seed = seed_marking(api.database, fleet, vertices=1)
    say(api, seed, engineer, ("confirmed", (1.0, 2.0)))
    built = build(engineer, seed).json()
    address = f"/rigs/{seed.rig_id}/correspondence-sets"
    brought = engineer.post(address, params={"camera": "front"}, content=ROWS, headers=CSV).json()
    for role in ("viewer", "annotator"):
        member = api.member(fleet, role)
        refused = member.get(f"/correspondence-sets/{built['id']}")
        assert (refused.status_code, refused.json()["code"]) == (403, "role_too_low")
        assert member.get(f"/correspondence-sets/{brought['id']}").status_code == 200
        assert member.get(address).json()["items"] == [brought], "its notes and counts say what people answered"
    assert reviewer.get(address).json()["items"] == [brought, built]
    assert reviewer.get(f"/correspondence-sets/{built['id']}").json()["pairs"]


def test_two_marks_far_apart_give_no_pair_and_that_is_said(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=2, marks_per_vertex=2)
    say(api, seed, api.member(fleet, "annotator", "one"), *[("confirmed", (100.0, 50.0))] * 2)
    say(api, seed, api.member(fleet, "annotator", "two"), ("confirmed", (101.0, 50.0)), ("confirmed", (127.0, 86.0)))
    made = build(engineer, seed).json()
    assert made["count"] == 1
    (note,) = (note for note in made["notes"] if "two marks lie more than" in note)
    assert note.startswith("1 of 2 corners are left out")


def test_vertices_that_stayed_where_they_were_measured_and_a_clock_that_was_set_back_are_said(api, fleet, engineer):
    seed = seed_marking(api.database, fleet, vertices=2)
    say(api, seed, api.member(fleet, "annotator"), *[("confirmed", (1.0, 2.0))] * 2)
    assert build(engineer, seed).json()["notes"] == []
    with api.database.writing() as session:
        session.get_one(VertexFrame, (seed.vertices[0], seed.camera_id)).gap_ns = -20_000_000
        lidar = session.scalars(select(Sensor).where(Sensor.kind == "lidar")).one()
        lidar.facts = {**lidar.facts, "jumps": [{"after_ns": 9_900_000_000, "duration_ns": -500_000_000}]}
        name = lidar.name
    nearest, clock = build(engineer, seed).json()["notes"]
    assert (
        nearest.startswith("Vertices were paired with the nearest frame, up to 20 ms away") and "mode auto" in nearest
    )
    assert clock.startswith(f"The clock of {name} was set back by 0.5 s at 9.9 s")


def test_the_toolboxs_labels_are_pairs_too(api, engineer, rig):
    labels = "1.000000 2.000000 4.000000 0.000000 0.500000 321.500000 201.000000\n"
    address = f"/rigs/{rig.id}/correspondence-sets?camera=front"
    made = engineer.post(address, content=labels, headers=CSV)
    assert made.status_code == 201 and "1 was subtracted" in made.json()["notes"][0]
    (pair,) = engineer.get(f"/correspondence-sets/{made.json()['id']}").json()["pairs"]
    assert (pair["u"], pair["v"], pair["group"]) == (320.5, 200.0, 1)
