"""Publishing against checks, what a camera was given before, and whose clock decides what is newest."""

from __future__ import annotations

from datetime import timedelta

import pytest
from sqlalchemy import select, text, update

from service.platform.db.calibrations import Calibration, CorrespondenceSet, Result
from service.platform.db.clock import utc_now
from service.platform.db.fleets import Rig
from service.platform.db.models import Publication
from tests.service.calibrations.test_results import (
    EDGE,
    FOUND,
    NEWER,
    ON_BOUNDS,
    current_address,
    failed,
    seed_results,
)
from tests.support.rows import make


def history(actor, rig, **query):
    answer = actor.get(f"/vehicles/{rig.vehicle_id}/cameras/front/publications", params=query)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_what_lies_on_its_bounds_is_published_by_an_override_only(api, fleet, rig, reviewer):
    _, (full, _) = seed_results(api, rig, found=ON_BOUNDS)
    assert failed(reviewer.get(f"/results/{full}").json()) == [EDGE]
    for body in (None, {}, {"reason": "It is good."}):
        refused = reviewer.post(f"/results/{full}/publication", body)
        assert (refused.status_code, refused.json()["code"]) == (409, "checks_stop"), refused.text
        assert failed(refused.json()) == [EDGE] and EDGE in refused.json()["detail"]
    assert reviewer.get(current_address(rig)).status_code == 404
    why = "The lens is new: Lea measured f_x."
    given = reviewer.post(f"/results/{full}/publication", {"override": {"reason": f" {why} "}})
    assert given.status_code == 201, given.text
    kept = {"published_by": "Rea", "reason": why, "override": {"reason": why, "sentences": [EDGE]}}
    current = api.member(fleet, "viewer").get(current_address(rig)).json()
    assert {name: current[name] for name in kept} == kept
    (row,) = history(reviewer, rig)["items"]
    assert row == given.json() and {name: row[name] for name in kept} == kept
    assert (row["model"], row["result_id"], row["is_current"]) == ("pinhole", str(full), True)


def test_an_override_of_nothing_is_a_reason(api, rig, reviewer):
    _, (full, _) = seed_results(api, rig)
    given = reviewer.post(f"/results/{full}/publication", {"override": {"reason": "To be sure."}}).json()
    assert (given["reason"], given["override"]) == ("To be sure.", None)


@pytest.mark.parametrize("reason", ["", "   ", "x" * 501, "a\nb", "gnp.\u202exof", "\u200b", "\u3164", None, 5, {}])
def test_a_reason_is_a_sentence_or_two_of_plain_text(api, rig, reviewer, reason):
    _, (full, _) = seed_results(api, rig, found=ON_BOUNDS)
    refused = reviewer.post(f"/results/{full}/publication", {"override": {"reason": reason}})
    assert (refused.status_code, refused.json()["code"]) == (422, "invalid_request")
    assert history(reviewer, rig)["items"] == []


def test_a_result_of_a_calibration_that_has_not_ended_is_held_back(api, rig, reviewer):
    _, (full, _) = seed_results(api, rig)
    with api.database.writing() as session:
        session.execute(update(Calibration).values(state="running", summary=None, remaining=1))
        session.execute(update(Result).values(checks=None, verdict=None))
    refused = reviewer.post(f"/results/{full}/publication")
    assert refused.json()["code"] == "checks_stop" and "has not ended" in refused.json()["detail"]


def test_worse_and_older_than_the_current_result_is_said_at_the_moment_of_asking(api, rig, reviewer):
    _, (old, _) = seed_results(api, rig, found=FOUND | {"heldout_mean_px": 3.0})
    assert failed(reviewer.get(f"/results/{old}").json()) == [], "nothing is current yet"
    with api.database.writing() as session:
        of = session.scalars(select(CorrespondenceSet)).one()
        newer_rig = make(Rig, fleet_id=rig.fleet_id, vehicle_id=rig.vehicle_id, name="roof 2")
        session.add(newer_rig)
        session.flush()
        newer = CorrespondenceSet(
            fleet_id=of.fleet_id, vehicle_id=of.vehicle_id, rig_id=newer_rig.id, camera="front", source="import",
            content_hash="1", count=60, pairs={}, notes=[], brought_at=utc_now() + timedelta(hours=1),
        )  # fmt: skip
        session.add(newer)
        session.flush()
        newer_id = newer.id
    _, (good, _) = seed_results(api, rig)
    with api.database.writing() as session:
        session.execute(
            text("UPDATE calibration_run SET set_id = :set WHERE id = (SELECT run_id FROM result WHERE id = :id)"),
            {"set": _raw(api, newer_id), "id": _raw(api, good)},
        )
    assert reviewer.post(f"/results/{good}/publication").status_code == 201
    changed, older = failed(reviewer.get(f"/results/{old}").json())
    assert changed == NEWER
    assert "This result is of the rig 'roof', the vehicle's current calibration of the newer rig 'roof 2'." in older
    assert "This result's pairs are of " in older and "those of the vehicle's current calibration are newer" in older
    assert failed(reviewer.get(f"/results/{good}").json()) == [], "it is the current one"
    # A person publishes it with a click; what they saw is kept.
    made = reviewer.post(f"/results/{old}/publication")
    assert made.status_code == 201 and made.json()["override"]["sentences"] == [changed, older]


def _raw(api, id):
    return id.hex if api.database.engine.dialect.name == "sqlite" else id


@pytest.mark.parametrize("alias", ["current", "canary"])
def test_the_one_before_is_given_again_with_a_reason_and_nothing_is_rewritten(api, rig, reviewer, alias):
    (first, _), (second, _) = (seed_results(api, rig)[1] for _ in range(2))
    reviewer.post(f"/results/{second}/publication", {"alias": "another"})  # has a history of its own

    def move(to, **more):
        return reviewer.post(f"/results/{to}/publication", {"alias": alias, **more})

    assert [move(result).status_code for result in (first, second)] == [201, 201]
    before = history(reviewer, rig, alias=alias)["items"]
    refused = move(first)
    assert (refused.status_code, refused.json()["code"]) == (422, "reason_missing")
    back = move(first, reason="The second one drives into kerbs.")
    assert back.status_code == 201, back.text
    assert move(first).status_code == 200, "it is the one that is given"
    after = history(reviewer, rig, alias=alias)["items"]
    assert [row["result_id"] for row in after] == [str(first), str(second), str(first)]
    assert after[1:] == [row | {"is_current": False} for row in before]
    assert after[0]["reason"] == "The second one drives into kerbs."


def test_the_history_comes_in_pages(api, fleet, rig, reviewer, viewer):
    results = [seed_results(api, rig, folds=(-1,))[1][0] for _ in range(5)]
    for result in results:
        reviewer.post(f"/results/{result}/publication")
    with api.database.writing() as session:
        for row in session.scalars(select(Publication)):
            row.created_at = utc_now() - timedelta(days=row.number)  # whatever the clocks say
    found, query = [], {"limit": 2}
    while query:
        page = history(viewer, rig, **query)
        found += page["items"]
        query = {"limit": 2, "after": page["next"]} if page["next"] else {}
    assert [row["result_id"] for row in found] == [str(one) for one in reversed(results)]
    assert [row["is_current"] for row in found] == [True, *[False] * 4]
    assert viewer.get(current_address(rig)).json()["result_id"] == str(results[-1])
    for cursor in ("x", str(rig.id), "\u00b2", "\u0661", "9" * 30):
        refused = viewer.get(f"/vehicles/{rig.vehicle_id}/cameras/front/publications", params={"after": cursor})
        assert (refused.status_code, refused.json()["code"]) == (422, "invalid_cursor")
