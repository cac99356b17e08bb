"""Aliases of a camera: each move keeps who, when and why, and an alias never loses its result silently."""

from __future__ import annotations

from service.platform.db.calibrations import Result
from service.publications import rules
from tests.service.calibrations.test_results import ON_BOUNDS, current_address, failed, seed_results
from tests.service.publications.given import camera_address, history, publish, same_moment, withdraw


def move(actor, to, alias="canary", reason="Two cars try it.", **more):
    return actor.post(f"/results/{to}/publication", {"alias": alias, "reason": reason, **more})


def remove(actor, rig, alias="canary", reason="The test is over."):
    newest = history(actor, rig, alias)[0]
    return actor.post(f"/publications/{newest['id']}/withdrawal", {"reason": reason})


def test_an_alias_moves_with_a_reason_and_remembers(api, rig, reviewer, viewer):
    first = publish(api, rig, reviewer)
    _, (second, left_out) = seed_results(api, rig)
    none = viewer.get(current_address(rig), params={"alias": "canary"})
    assert none.json()["code"] == "no_calibration_yet" and "'canary'" in none.json()["detail"]
    made = move(reviewer, second)
    assert made.status_code == 201, made.text
    assert made.json()["published_by"] == "Rea" and made.json()["is_current"]
    given = viewer.get(current_address(rig), params={"alias": "canary"}).json()
    assert (given["result_id"], given["alias"], given["reason"]) == (str(second), "canary", "Two cars try it.")
    assert given["publication_id"] == made.json()["id"]
    whole = viewer.get(f"/vehicles/{rig.vehicle_id}/calibration", params={"alias": "canary"}).json()
    assert whole["cameras"]["front"] == given and whole["alias"] == "canary"
    # `current` is what was published, whatever the canary has.
    assert viewer.get(current_address(rig)).json()["publication_id"] == first["id"]
    assert move(reviewer, first["result_id"], reason="Back.").status_code == 201
    moves = history(viewer, rig, "canary")
    assert [(one["result_id"], one["reason"], one["is_current"]) for one in moves] == [
        (first["result_id"], "Back.", True), (str(second), "Two cars try it.", False)
    ]  # fmt: skip
    address, of_alias = f"{camera_address(rig)}/publications", {"alias": "canary"}
    page = viewer.get(address, params={**of_alias, "limit": 1}).json()
    rest = viewer.get(address, params={**of_alias, "after": page["next"]}).json()
    assert page["items"] + rest["items"] == moves and rest["next"] is None
    newest = viewer.get(f"{camera_address(rig)}/aliases").json()["items"]
    assert [(one["alias"], one["id"]) for one in newest] == [("canary", moves[0]["id"]), ("current", first["id"])]
    then = viewer.get(current_address(rig), params={"alias": "canary", "as_of": made.json()["published_at"]}).json()
    assert then["result_id"] == str(second) and same_moment(then["validity"]["until"], moves[0]["published_at"])
    assert move(reviewer, left_out).json()["code"] == "not_publishable"


def test_an_alias_that_is_taken_away_says_so(api, rig, reviewer, viewer):
    given = publish(api, rig, reviewer)
    made = move(reviewer, given["result_id"])
    assert made.status_code == 201
    again = move(reviewer, given["result_id"], reason="Once more.")
    assert (again.status_code, again.json()) == (200, made.json())
    removed = remove(reviewer, rig)
    assert removed.status_code == 201
    assert reviewer.post(f"/publications/{removed.json()['id']}/withdrawal", {"reason": "x"}).status_code == 409
    assert failed(reviewer.get(f"/results/{given['result_id']}").json()) == [], "a removed alias is no doubt"
    gone = viewer.get(current_address(rig), params={"alias": "canary"})
    assert (gone.status_code, gone.json()["code"]) == (410, "calibration_withdrawn")
    assert "The test is over." in gone.json()["detail"]
    assert viewer.get(current_address(rig)).status_code == 200


def test_a_withdrawal_takes_the_aliases_of_the_same_result_along(api, rig, reviewer, viewer):
    good, bad = publish(api, rig, reviewer), publish(api, rig, reviewer)
    assert move(reviewer, bad["result_id"]).status_code == 201
    assert move(reviewer, good["result_id"], "tuesday").status_code == 201
    withdraw(reviewer, bad, "The mast was bent.")
    gone = viewer.get(current_address(rig), params={"alias": "canary"})
    assert gone.status_code == 410 and "The mast was bent." in gone.json()["detail"]
    assert viewer.get(current_address(rig), params={"alias": "tuesday"}).status_code == 200


def test_an_alias_whose_result_is_deleted_says_that_it_was_deleted(api, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    _, (tried, _) = seed_results(api, rig)
    moved = move(reviewer, tried).json()
    etag = viewer.get(f"/vehicles/{rig.vehicle_id}/calibration", params={"alias": "canary"}).headers["etag"]
    with api.database.writing() as session:
        session.delete(session.get_one(Result, tried))
    for address in (current_address(rig), f"/vehicles/{rig.vehicle_id}/calibration"):
        gone = viewer.get(address, params={"alias": "canary"}, headers={"If-None-Match": etag})
        assert (gone.status_code, gone.json()["code"]) == (410, "calibration_deleted"), gone.text
        assert "was deleted" in gone.json()["detail"] and "withdrawn" not in gone.json()["detail"]
        (said,) = gone.json()["deleted"]
        assert (said["camera"], said["result_id"]) == ("front", str(tried))
        then = viewer.get(address, params={"alias": "canary", "as_of": moved["published_at"]})
        assert then.json()["code"] == "calibration_deleted"
    listed = viewer.get(f"{camera_address(rig)}/aliases").json()["items"][0]
    assert (listed["alias"], listed["result_id"], listed["led_to"]) == ("canary", None, str(tried))
    assert remove(reviewer, rig).json()["code"] == "not_current"
    _, (again, _) = seed_results(api, rig)
    assert move(reviewer, again, reason="The next one.").json()["led_to"] == str(again)
    assert remove(reviewer, rig).json()["led_to"] is None
    removed = viewer.get(current_address(rig), params={"alias": "canary"})
    assert removed.json()["code"] == "calibration_withdrawn" and "The test is over." in removed.json()["detail"]


def test_checks_hold_for_aliases_too(api, rig, reviewer, viewer):
    _, (edge, _) = seed_results(api, rig, found=ON_BOUNDS)
    refused = move(reviewer, edge)
    assert refused.json()["code"] == "checks_stop" and "edge of its bounds" in refused.json()["detail"]
    made = move(reviewer, edge, reason=None, override={"reason": "Two cars try it."}).json()
    assert "edge of its bounds" in made["override"]["sentences"][0]
    given = viewer.get(current_address(rig), params={"alias": "canary"}).json()
    assert given["override"] == made["override"]


def test_what_an_alias_cannot_be(api, rig, reviewer):
    given = publish(api, rig, reviewer)
    for name in ("Canary", "-x", "x" * 65, "a b"):
        assert move(reviewer, given["result_id"], name).status_code == 422
    assert move(reviewer, given["result_id"], reason=" ").status_code == 422


def test_a_camera_has_a_page_of_aliases(api, rig, reviewer, monkeypatch):
    given = publish(api, rig, reviewer)
    monkeypatch.setattr(rules, "_MOST_ALIASES", 3)
    for name in ("one", "two"):
        assert move(reviewer, given["result_id"], name).status_code == 201
    assert move(reviewer, given["result_id"], "three").json()["code"] == "too_many_aliases"
    assert remove(reviewer, rig, "two").status_code == 201
    assert move(reviewer, given["result_id"], "two", reason="Again.").status_code == 201
