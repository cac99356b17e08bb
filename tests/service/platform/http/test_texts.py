"""What no text is and what cannot be seen: refused in every body, query and path, and never a failure of ours."""

import json

import pytest

from service.platform.http.problems import Problem
from tests.support.people import Api
from tests.support.uploads import RIG, new_vehicle

# Lone halves and NUL as JSON spells them, and a half as bytes, which Python's reader takes too.
NO_TEXTS = [rb'"\ud800"', rb'"a\udfff"', b'"\xed\xa0\x80"', rb'"a\u0000b"']
HIDDEN = ["a\u202eb", "a\u2066b", "a\u200fb", "a\u200bb", "a\u061cb", "\ufeffa", "a\u2028b", "a\x9bb", "a\x1b[2Jb"]
EMPTY = ["\u3164", "\u2800\u200d", "\u115f \u034f"]


def send(actor, path: str, body: bytes, method: str = "POST"):
    return actor.request(method, path, content=body, headers={"Content-Type": "application/json"})


@pytest.mark.parametrize("text", NO_TEXTS)
def test_what_is_no_text_is_refused_wherever_it_stands(api: Api, text: bytes) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    van = new_vehicle(engineer, fleet, "van")
    value = b'{"name": %b}' % text
    bodies = {
        f"/fleets/{fleet}/vehicles": [value, b'{"name": "x", %b: 1}' % text, text, b"[%b]" % text],
        f"/fleets/{fleet}/invitations": [b'{"name": "x", "role": %b}' % text],
        f"/vehicles/{van['vehicle']}/rigs": [value, b'{"lidar": {%b: {}}, "cameras": [{%b: 1}]}' % (text, text)],
        f"/vehicles/{van['vehicle']}/recordings": [b'{"reading": {"topics": {"cameras": {%b: "/t"}}}}' % text],
        f"/rigs/{van['rig']}/correspondence-sets?camera=front": [
            b'{"pairs": [{%b: 1}]}' % text,
            b'{"pairs": [{"x": 1, "y": 1, "z": 1, "u": 1, "v": 1, "group": %b}]}' % text,
            b'{%b: 1, "pairs": []}' % text,
        ],
        f"/vehicles/{van['vehicle']}/calibrations": [
            b'{"correspondence_set_ids": [], "intrinsics": {"front": {%b: %b}}}' % (text, text)
        ],
        f"/fleets/{fleet}/fleet-requests": [
            b'{"vehicles": {"name": %b}}' % text,
            b'{"calibration": {%b: 1}}' % text,
            b'{"vehicles": {}, "calibration": {"bounds": {%b: [0, 1]}}}' % text,
            b'{"vehicles": {}, "calibration": {"locked": {%b: 1}}}' % text,
        ],
        "/sign-in": [b'{"link": %b}' % text],
    }
    for path, given in bodies.items():
        for body in given:
            answer = send(engineer, path, body)
            assert answer.status_code == 422, (path, body, answer.text)
            assert answer.json()["detail"] and answer.json()["hint"], (path, body)


def test_a_refusal_may_hold_what_no_text_is() -> None:
    body = Problem(422, "strange", "There is no \ud800.", "Not \x00.", key="\udfff\U0001f680").response().body
    document = json.loads(body)
    assert (document["detail"], document["key"]) == ("There is no \ud800.", "\udfff\U0001f680")


@pytest.mark.parametrize("name", [*HIDDEN, *EMPTY])
def test_names_can_be_told_apart_by_looking(api: Api, name: str) -> None:
    fleet = api.fleet()
    admin = api.member(fleet, "admin")
    van = new_vehicle(admin, fleet, "van")
    for path, body in (
        (f"/fleets/{fleet}/vehicles", {"name": name}),
        (f"/fleets/{fleet}/invitations", {"name": name, "role": "viewer"}),
        (f"/fleets/{fleet}/tokens", {"name": name, "role": "viewer"}),
        (f"/vehicles/{van['vehicle']}/rigs", RIG | {"name": name}),
        (f"/vehicles/{van['vehicle']}/recordings", {"rig_id": van["rig"], "name": name, "file_name": "x.bag"}),
        (f"/vehicles/{van['vehicle']}/recordings", {"rig_id": van["rig"], "name": "x", "file_name": name}),
    ):
        answer = admin.post(path, body)
        assert (answer.status_code, answer.json()["code"]) == (422, "invalid_request"), (path, answer.text)
        assert "seen" in answer.json()["detail"]


def test_names_have_one_spelling(api: Api) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    made = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "Cafe\u0301"})
    assert made.json()["name"] == "Caf\u00e9"
    twin = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "Caf\u00e9"})
    assert (twin.status_code, twin.json()["code"]) == (409, "name_taken")
    # Letters that grow when they are composed may not outgrow the column.
    grown = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "\ufb2c" * 199})
    assert grown.status_code == 422
    for fine in ("نمونه\u200cها", "क\u094d\u200dष", "👩\u200d🚀", "车 1", "A/B (rear), #2"):
        assert engineer.post(f"/fleets/{fleet}/vehicles", {"name": fine}).status_code == 201, fine


def test_a_nul_in_a_path_or_query_finds_nothing(api: Api) -> None:
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    van = new_vehicle(engineer, fleet, "van")
    nowhere = "00000000-0000-7000-8000-000000000000"
    for path in (
        f"/vehicles/{van['vehicle']}/cameras/a%00b/calibration",
        f"/recordings/{nowhere}/cameras/a%00b/frames",
        f"/recordings/{nowhere}/cameras/a%00b/frames/0/mark",
        f"/detections/{nowhere}/vertices?camera=a%00b",
        f"/detections/{nowhere}/progress?camera=%00",
        "/fleets?after=%00",
    ):
        answer = engineer.get(path)
        assert answer.status_code == 422, (path, answer.text)
