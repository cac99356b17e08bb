"""A report from the request to the file: made by a worker, read over HTTP, shown to whom it may be shown."""

import hashlib

import pytest
from sqlalchemy import select, update

from apexcal.documents.analyses import ReportView
from service.platform.db.calibrations import CorrespondenceSet, Result
from service.platform.db.fleets import Fleet
from service.platform.db.models import Blob
from tests.contract.test_work import SCHEDULE, pairs_of_a_pinhole
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.databases import one_database
from tests.support.reports import data_of
from tests.support.work import work


@pytest.fixture
def result(context, engineer, rig):
    """The result of a finished calibration without a report."""
    body = {"models": ["pinhole"], "folds": 2, "schedule": SCHEDULE}
    brought = bring_pairs(engineer, rig.id, pairs_of_a_pinhole())
    asked = ask_calibration(engineer, rig.vehicle_id, brought, **body)
    work(context)
    done = engineer.get(f"/calibrations/{asked}").json()
    return done["summary"]["cameras"]["front"]["models"]["pinhole"]["result_id"]


def ask(engineer, result):
    """The address of a report that is asked for."""
    asked = engineer.post("/analyses", {"kind": "report", "result_id": str(result)})
    assert asked.status_code == 202, asked.text
    return f"/analyses/{asked.json()['id']}"


def test_a_report_shows_the_result_and_counts_to_the_quota(api, context, fleet, engineer, result):
    before = engineer.get(f"/fleets/{fleet}").json()["taken_bytes"]
    report = ask(engineer, result)
    assert engineer.get(f"{report}/file").json()["code"] == "no_file"
    work(context)
    ended = ReportView.model_validate_json(engineer.get(report).content, extra="forbid")
    assert (ended.state, ended.problem) == ("done", None)
    answer = engineer.get(f"{report}/file")
    assert answer.status_code == 200 and answer.headers["content-type"].startswith("text/html")
    assert "sandbox" in answer.headers["content-security-policy"]
    assert len(answer.content) == ended.result.size
    assert hashlib.sha256(answer.content).hexdigest() == ended.result.sha256
    assert engineer.get(f"/fleets/{fleet}").json()["taken_bytes"] == before + ended.result.size
    data = data_of(answer.text)
    stored = engineer.get(f"/results/{result}").json()
    shown = data["result"]
    assert shown["id"] == result and shown["verdict"] == ended.result.verdict == stored["verdict"]
    assert {name: value for name, value in shown.items() if stored[name] != value} == {}
    assert data["summary"]["models"]["pinhole"]["result_id"] == result
    held = [value for value in data["pairs"]["heldout_px"] if value is not None]
    assert len(held) == 80
    same = {"If-None-Match": answer.headers["etag"]}
    assert engineer.get(f"{report}/file", headers=same).status_code == 304
    assert answer.headers["content-disposition"].startswith("inline")
    saved = engineer.get(f"{report}/file", params={"download": "true"})
    assert saved.headers["content-disposition"] == "attachment; filename*=UTF-8''front-pinhole-report.html"
    assert api.member(fleet, "viewer").get(f"{report}/file").status_code == 200
    # What is deleted takes nothing.
    assert api.member(fleet, "reviewer").delete(report).status_code == 204
    assert engineer.get(f"/fleets/{fleet}").json()["taken_bytes"] == before
    with api.database.reading() as session:
        states = session.scalars(select(Blob.state).where(Blob.key.startswith("reports/"))).all()
    assert states == ["condemned"]


@one_database
def test_a_fleet_without_room_for_a_report_hears_why(api, context, engineer, result):
    with api.database.writing() as session:
        session.execute(update(Fleet).values(quota_bytes=1000))
    report = ask(engineer, result)
    work(context)
    row = engineer.get(report).json()
    assert (row["state"], row["problem"]["code"]) == ("failed", "fleet_quota_exceeded")


@one_database
def test_a_report_and_cars_are_given_what_other_data_say(context, engineer, rig, result):
    found = engineer.get(f"/results/{result}").json()
    made = engineer.post(f"/results/{result}/publication", {"override": {"reason": "Measured by hand."}})
    assert made.status_code == 201, made.text
    of_car = f"/vehicles/{rig.vehicle_id}/calibration"
    first = engineer.get(of_car)
    assert first.json()["cameras"]["front"]["quality"]["verdict"] == found["verdict"] != "stop"
    turned = [pair | {"u": pair["u"] + 30.0} for pair in pairs_of_a_pinhole()]
    others = [bring_pairs(engineer, rig.id, pairs) for pairs in (pairs_of_a_pinhole()[:60], turned)]
    for one in (found["set_id"], *others):
        body = {"kind": "pair_validation", "set_id": one, "result_id": result}
        assert engineer.post("/analyses", body).status_code == 202
    # Reports are no validations.
    ask(engineer, result)
    work(context)
    report = ask(engineer, result)
    work(context)
    data = data_of(engineer.get(f"{report}/file").text)
    # The set that was fitted to is no other data. The newest is first.
    assert [one["verdict"] for one in data["elsewhere"]] == ["disagrees", "agrees"]
    assert all("u" not in one for one in data["elsewhere"])
    check = next(one for one in data["result"]["checks"] if one["name"] == "elsewhere")
    assert check["verdict"] == "stop"
    assert data["result"]["verdict"] == "stop"
    again = engineer.get(of_car, headers={"If-None-Match": first.headers["etag"]})
    assert again.status_code == 200 and again.json()["cameras"]["front"]["quality"]["verdict"] == "stop"


@one_database
def test_of_marks_only_reviewers_see_it_and_only_of_a_whole_fit(api, context, fleet, engineer, result):
    report = ask(engineer, result)
    work(context)
    with api.database.writing() as session:
        session.execute(update(CorrespondenceSet).values(source="annotations"))
    refused = api.member(fleet, "annotator").get(f"{report}/file")
    assert (refused.status_code, refused.json()["code"]) == (403, "role_too_low")
    assert api.member(fleet, "reviewer").get(f"{report}/file").status_code == 200
    assert api.member(api.fleet(), "admin").get(f"{report}/file").status_code == 404
    with api.database.reading() as session:
        fold = session.scalars(select(Result.id).where(Result.fold == 0)).one()
    refused = engineer.post("/analyses", {"kind": "report", "result_id": str(fold)})
    assert refused.json()["code"] == "not_a_fit_to_all_pairs"
