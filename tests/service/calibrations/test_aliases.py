"""Aliases of a camera: each move keeps who, when and why, and an alias never loses its result silently."""

from __future__ import annotations

from sqlalchemy import update

from service.db.aliases import AliasMove
from service.db.calibrations import Result
from tests.service.calibrations.given import camera_address, publish, same_moment, withdraw
from tests.service.calibrations.test_results import FOUND, current_address, seed_results

ON_BOUNDS = FOUND | {"at_bounds": ["f_x"]}


def move(actor, rig, to, alias="canary", reason="Two cars try it.", **more):
    body = {"result_id": None if to is None else str(to), "reason": reason, **more}
    return actor.post(f"{camera_address(rig)}/aliases/{alias}/moves", body)


def test_an_alias_moves_with_a_reason_and_remembers(api, rig, reviewer, viewer):
    first = publish(api, rig, reviewer)
    _, (second, left_out) = seed_results(api, rig)
    none = viewer.get(current_address(rig), params={"alias": "canary"})
    assert none.json()["code"] == "no_calibration_yet" and "'canary'" in none.json()["detail"]
    made = move(reviewer, rig, second)
    assert made.status_code == 201, made.text
    assert made.json()["moved_by"] == "Rea" and made.json()["is_current"]
    given = viewer.get(current_address(rig), params={"alias": "canary"}).json()
    assert (given["result_id"], given["alias"], given["reason"]) == (str(second), "canary", "Two cars try it.")
    assert given["publication_id"] == made.json()["id"]
    whole = viewer.get(f"/vehicles/{rig.vehicle_id}/calibration", params={"alias": "canary"}).json()
    assert whole["cameras"]["front"] == given and whole["alias"] == "canary"
    # `current` is what was published, whatever the canary has.
    assert viewer.get(current_address(rig)).json()["publication_id"] == first["id"]
    assert move(reviewer, rig, first["result_id"], reason="Back.").status_code == 201
    moves = viewer.get(f"{camera_address(rig)}/aliases/canary/moves").json()["items"]
    assert [(one["result_id"], one["reason"], one["is_current"]) for one in moves] == [
        (first["result_id"], "Back.", True), (str(second), "Two cars try it.", False)
    ]  # fmt: skip
    page = viewer.get(f"{camera_address(rig)}/aliases/canary/moves", params={"limit": 1}).json()
    rest = viewer.get(f"{camera_address(rig)}/aliases/canary/moves", params={"after": page["next"]}).json()
    assert page["items"] + rest["items"] == moves and rest["next"] is None
    assert [one["alias"] for one in viewer.get(f"{camera_address(rig)}/aliases").json()["items"]] == ["canary"]
    then = viewer.get(current_address(rig), params={"alias": "canary", "as_of": made.json()["moved_at"]}).json()
    assert then["result_id"] == str(second) and same_moment(then["validity"]["until"], moves[0]["moved_at"])
    assert move(reviewer, rig, left_out).json()["code"] == "not_publishable"


def test_an_alias_that_is_taken_away_says_so(api, rig, reviewer, viewer):
    given = publish(api, rig, reviewer)
    assert move(reviewer, rig, None).json()["code"] == "alias_leads_nowhere"
    assert move(reviewer, rig, given["result_id"]).status_code == 201
    assert move(reviewer, rig, None, reason="The test is over.").status_code == 201
    gone = viewer.get(current_address(rig), params={"alias": "canary"})
    assert (gone.status_code, gone.json()["code"]) == (410, "calibration_withdrawn")
    assert "The test is over." in gone.json()["detail"]
    assert viewer.get(current_address(rig)).status_code == 200


def test_a_withdrawal_takes_the_aliases_of_the_same_result_along(api, rig, reviewer, viewer):
    bad, good = publish(api, rig, reviewer), publish(api, rig, reviewer)
    assert move(reviewer, rig, bad["result_id"]).status_code == 201
    assert move(reviewer, rig, good["result_id"], "tuesday").status_code == 201
    withdraw(reviewer, bad, "The mast was bent.")
    gone = viewer.get(current_address(rig), params={"alias": "canary"})
    assert gone.status_code == 410 and "The mast was bent." in gone.json()["detail"]
    assert viewer.get(current_address(rig), params={"alias": "tuesday"}).status_code == 200


def test_an_alias_whose_result_is_deleted_says_that_it_was_deleted(api, rig, reviewer, viewer):
    publish(api, rig, reviewer)
    _, (tried, _) = seed_results(api, rig)
    moved = move(reviewer, rig, tried).json()
    etag = viewer.get(f"/vehicles/{rig.vehicle_id}/calibration", params={"alias": "canary"}).headers["etag"]
    with api.database.writing() as session:
        session.delete(session.get_one(Result, tried))
    for address in (current_address(rig), f"/vehicles/{rig.vehicle_id}/calibration"):
        gone = viewer.get(address, params={"alias": "canary"}, headers={"If-None-Match": etag})
        assert (gone.status_code, gone.json()["code"]) == (410, "calibration_deleted"), gone.text
        assert "was deleted" in gone.json()["detail"] and "withdrawn" not in gone.json()["detail"]
        (said,) = gone.json()["deleted"]
        assert (said["camera"], said["result_id"]) == ("front", str(tried))
        then = viewer.get(address, params={"alias": "canary", "as_of": moved["moved_at"]})
        assert then.json()["code"] == "calibration_deleted"
    (listed,) = viewer.get(f"{camera_address(rig)}/aliases").json()["items"]
    assert (listed["result_id"], listed["led_to"]) == (None, str(tried))
    assert move(reviewer, rig, None, reason="It is gone.").json()["code"] == "alias_leads_nowhere"
    _, (again, _) = seed_results(api, rig)
    assert move(reviewer, rig, again, reason="The next one.").json()["led_to"] == str(again)
    assert move(reviewer, rig, None, reason="The test is over.").json()["led_to"] is None
    removed = viewer.get(current_address(rig), params={"alias": "canary"})
    assert removed.json()["code"] == "calibration_withdrawn" and "The test is over." in removed.json()["detail"]


def test_a_move_by_an_older_version_of_the_service_is_read(api, rig, reviewer, viewer):
    """It writes no ``led_to``; without one a deleted result cannot be told from a removed alias."""
    _, (tried, _) = seed_results(api, rig)
    assert move(reviewer, rig, tried).status_code == 201
    with api.database.writing() as session:
        session.execute(update(AliasMove).values(led_to=None))
    assert viewer.get(current_address(rig), params={"alias": "canary"}).json()["result_id"] == str(tried)
    (listed,) = viewer.get(f"{camera_address(rig)}/aliases").json()["items"]
    assert listed["led_to"] == listed["result_id"] == str(tried)
    with api.database.writing() as session:
        session.delete(session.get_one(Result, tried))
    gone = viewer.get(current_address(rig), params={"alias": "canary"})
    assert (gone.status_code, gone.json()["code"]) == (410, "calibration_withdrawn")
    _, (again, _) = seed_results(api, rig)
    assert move(reviewer, rig, again, reason="The next one.").status_code == 201
    assert viewer.get(current_address(rig), params={"alias": "canary"}).json()["result_id"] == str(again)


def test_objections_hold_for_aliases_too(api, rig, reviewer, viewer):
    _, (edge, _) = seed_results(api, rig, found=ON_BOUNDS)
    refused = move(reviewer, rig, edge)
    assert refused.json()["code"] == "objections" and "edge of its bounds" in refused.json()["detail"]
    made = move(reviewer, rig, edge, override=True).json()
    assert "edge of its bounds" in made["override"]["objections"][0]
    given = viewer.get(current_address(rig), params={"alias": "canary"}).json()
    assert given["override"] == made["override"]


def test_what_an_alias_cannot_be(api, fleet, rig, reviewer, viewer):
    given = publish(api, rig, reviewer)
    assert move(viewer, rig, given["result_id"]).status_code == 403
    assert move(reviewer, rig, given["result_id"], "current").json()["code"] == "alias_is_published"
    for name in ("Canary", "-x", "x" * 65, "a b"):
        assert move(reviewer, rig, given["result_id"], name).status_code == 422
    assert move(reviewer, rig, given["result_id"], reason=" ").status_code == 422
    other = reviewer.post(
        f"/vehicles/{rig.vehicle_id}/cameras/rear/aliases/canary/moves",
        {"result_id": given["result_id"], "reason": "x"},
    )
    assert other.json()["code"] == "of_another_camera"
    for after in ("x", "²", "9" * 30):
        asked = viewer.get(f"{camera_address(rig)}/aliases/canary/moves", params={"after": after})
        assert asked.json()["code"] == "invalid_cursor"
