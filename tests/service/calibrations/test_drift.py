"""How results of a camera differ, two of them and over time, over HTTP and on both databases."""

import re
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from itertools import pairwise, zip_longest
from uuid import UUID

import pytest
from sqlalchemy import event

from apexcal.geometry.se3 import from_document, to_document
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result
from tests.support.databases import one_database
from tests.support.results import fit_result, model_summary, summary
from tests.support.rows import LEVEL

LENS = {"model": "pinhole", "parameters": {"f_x": 400, "f_y": 400, "c_x": 320, "c_y": 240}, "image_size": [640, 480]}


@contextmanager
def sql(database):
    """The statements that reach the database meanwhile."""
    sent = []

    def note(connection, cursor, statement, *_):
        sent.append(statement)

    event.listen(database.engine, "before_cursor_execute", note)
    yield sent
    event.remove(database.engine, "before_cursor_execute", note)


def seed_results(api, rig, mounts, changes=()):
    """Recommended results, a day apart: (t_x in metres) each, stated to 5 mm and 0.05 degrees.

    ``changes``: for each in its order, another ``model``, ``lens`` or ``verdict``.
    """
    names = ["rotation_x", "rotation_y", "rotation_z", "t_x", "t_y", "t_z"]
    std = dict(zip(names, [0.05] * 3 + [0.005] * 3, strict=True))
    matrix = [[std[a] ** 2 if a == b else 0.0 for b in names] for a in names]
    with api.database.writing() as session:
        for day, (t_x, change) in enumerate(zip_longest(mounts, changes, fillvalue={})):
            of = {"model": "pinhole", "lens": "fitted", "verdict": "pass"} | change
            made = datetime(2026, 3, 1, tzinfo=UTC) + timedelta(days=day)
            owned = {"fleet_id": rig.fleet_id}
            pairs = CorrespondenceSet(
                **owned, vehicle_id=rig.vehicle_id, rig_id=rig.id, camera="front", source="import", created_at=made
            )
            pairs.content_hash, pairs.count, pairs.pairs = str(day), 0, {}
            calibration = Calibration(
                **owned, vehicle_id=rig.vehicle_id, rig_id=rig.id, request={}, content_hash=str(day), state="done"
            )
            calibration.remaining, calibration.publish = 0, "none"
            session.add_all([pairs, calibration])
            session.flush()
            run = CalibrationRun(**owned, calibration_id=calibration.id, set_id=pairs.id, camera="front", fold=-1)
            run.model, run.farm, run.slots, run.bundle, run.fit_request = of["model"], "runs", 1, 1, {}
            session.add(run)
            session.flush()
            result = Result(**owned, calibration_id=calibration.id, run_id=run.id, camera="front")
            result.model, result.fold = of["model"], -1
            result.document = fit_result(
                intrinsics={"model": "pinhole", **LENS["parameters"], "image_size": [640, 480]},
                transform=to_document(from_document(LEVEL | {"translation_m": [t_x, -0.1, -0.2]})),
                std=std,
                covariance={"names": names, "units": [], "matrix": matrix},
                lens=of["lens"],
            )
            result.checks, result.verdict = [], of["verdict"]
            session.add(result)
            session.flush()
            calibration.summary = summary({of["model"]: model_summary(result.id, verdict=of["verdict"])})


def test_drift_reads_no_whole_documents(api, engineer, rig):
    seed_results(api, rig, [0.0, 0.001, 0.060])
    with sql(api.database) as sent:
        engineer.get(f"/vehicles/{rig.vehicle_id}/drift", params={"camera": "front"})
    of_results = [one for one in sent if "result.document" in one]
    # One statement for all results, and of each only what is compared.
    assert len(of_results) == 1
    assert "result.document" not in re.sub(r"JSON_EXTRACT\(result\.document|result\.document ->", "", of_results[0])


@pytest.mark.parametrize(
    ("mounts", "said"),
    [
        ([0.0, 0.002, -0.003], "the mount did not move significantly"),
        ([0.0, 0.001, 0.060], "the mount moved (at 2026-03-03)"),
        ([0.0, 0.013, 0.026, 0.039, 0.052], "no step is significant, but"),
        ([0.0], "drift needs two"),
    ],
)
def test_drift_compares_each_result_with_the_one_before_and_the_first(api, engineer, rig, mounts, said):
    seed_results(api, rig, mounts)
    drift = engineer.get(f"/vehicles/{rig.vehicle_id}/drift", params={"camera": "front"}).json()
    assert said in drift["sentence"]
    steps = drift["steps"]
    assert [step["transform"]["translation_m"][0] for step in steps] == mounts
    assert steps[0]["from_previous"] is None
    for before, step in pairwise(steps):
        moved = step["transform"]["translation_m"][0] - before["transform"]["translation_m"][0]
        assert step["from_previous"]["translation_mm"] == pytest.approx(1e3 * abs(moved))
        assert step["from_first"]["translation_mm"] == pytest.approx(
            1e3 * abs(step["transform"]["translation_m"][0] - mounts[0])
        )


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ([{"verdict": "look"}, {}], "the earlier result (pairs of 2026-03-01 00:00) does not pass its checks"),
        ([{}, {"verdict": "stop"}], "the later result (pairs of 2026-03-02 00:00) does not pass its checks"),
        (
            [{"verdict": "stop"}, {"verdict": "look"}],
            "neither the earlier result (pairs of 2026-03-01 00:00) nor the later result (pairs of 2026-03-02 00:00) "
            "passes its checks",
        ),
        ([{}, {"model": "brown_conrady"}], "their lens models are pinhole and brown_conrady, and a mount belongs"),
        ([{"lens": "stated"}, {}], "the lens of the earlier result is stated, that of the later fitted"),
    ],
)
@one_database
def test_drift_says_why_it_cannot_say_whether_the_mount_moved(api, engineer, rig, changes, why):
    seed_results(api, rig, [0.0, 0.060], changes)
    drift = drift_of(engineer, rig)
    assert f"No drift is told: {why}" in drift["sentence"] and "moved (" not in drift["sentence"]
    difference = drift["steps"][1]["from_previous"]
    assert not difference["differs"] and difference["incomparable"].startswith(why)
    # How far they are apart is said all the same.
    assert difference["translation_mm"] == pytest.approx(60.0) and "60 mm" in drift["sentence"]


def drift_of(engineer, rig, **asked):
    return engineer.get(f"/vehicles/{rig.vehicle_id}/drift", params={"camera": "front", **asked}).json()


def test_drift_has_pages_and_compares_over_their_borders(api, engineer, rig):
    mounts = [0.0, 0.001, 0.060, 0.061, 0.062]
    seed_results(api, rig, mounts)
    newest = drift_of(engineer, rig, limit=2)
    middle = drift_of(engineer, rig, limit=2, after=newest["next"])
    oldest = drift_of(engineer, rig, limit=2, after=middle["next"])
    pages = [[step["transform"]["translation_m"][0] for step in one["steps"]] for one in (oldest, middle, newest)]
    assert pages == [[0.0], [0.001, 0.060], [0.061, 0.062]]
    assert oldest["next"] is None and oldest["steps"][0]["from_previous"] is None
    # The first of a page has no first before it, but one before.
    first = newest["steps"][0]
    assert first["from_first"] is None and first["from_previous"]["shift_mm"][0] == pytest.approx(1.0)
    assert newest["steps"][0]["std"]["t_x"] == 0.005
    refused = engineer.get(f"/vehicles/{rig.vehicle_id}/drift", params={"camera": "front", "after": rig.id.hex})
    assert (refused.status_code, refused.json()["code"]) == (422, "invalid_cursor")
    assert drift_of(engineer, rig, after="nothing")["code"] == "invalid_cursor"


def test_drift_marks_what_was_withdrawn_and_compares_nothing_with_it(api, fleet, engineer, rig, reviewer):
    seed_results(api, rig, [0.0, 0.060, 0.001])
    moved = drift_of(engineer, rig)["steps"][1]["result_id"]
    said = reviewer.post(f"/results/{moved}/publication", {"reason": "to be looked at"})
    assert said.status_code == 201, said.text
    publication = said.json()["id"]
    assert drift_of(engineer, rig)["steps"][1]["withdrawn"] is None
    gone = reviewer.post(f"/publications/{publication}/withdrawal", {"reason": "the board was bent"})
    assert gone.status_code in (200, 201), gone.text
    drift = drift_of(engineer, rig)
    _, withdrawn, last = drift["steps"]
    assert withdrawn["withdrawn"]["reason"] == "the board was bent"
    assert withdrawn["from_previous"]["differs"]
    assert last["from_previous"]["shift_mm"][0] == pytest.approx(1.0), "compared with the first"
    assert "did not move" in drift["sentence"] and "1 withdrawn result is left out" in drift["sentence"]
    again = reviewer.post(f"/results/{moved}/publication", {"override": {"reason": "it was not"}})
    assert again.status_code == 201, again.text
    assert drift_of(engineer, rig)["steps"][1]["withdrawn"] is None


def test_two_results_of_a_camera_are_compared(api, fleet, engineer, rig):
    seed_results(api, rig, [0.0, 0.060])
    one, other = (step["result_id"] for step in drift_of(engineer, rig)["steps"])
    found = api.member(fleet, "viewer").get(f"/results/{one}/comparison", params={"other": other}).json()
    assert found["translation_mm"] == pytest.approx(60.0)
    assert found["differs"] and not found["shares_pairs"] and "more than chance" in found["sentence"]
    assert found["parameters"][3] == {
        "name": "t_x",
        "unit": "mm",
        "difference": pytest.approx(-60.0),
        "std": pytest.approx(5.0 * 2**0.5),
        "sigmas": pytest.approx(60.0 / (5.0 * 2**0.5)),
    }
    itself = engineer.get(f"/results/{one}/comparison", params={"other": one}).json()
    assert itself["shares_pairs"] and itself["sigmas"] == 0.0
    with api.database.writing() as session:
        row = session.get(Result, UUID(other))
        row.camera = "rear"
    refused = engineer.get(f"/results/{one}/comparison", params={"other": other})
    assert (refused.status_code, refused.json()["code"]) == (422, "result_of_another_camera")
    stranger = api.member(api.fleet(), "engineer")
    assert stranger.get(f"/results/{one}/comparison", params={"other": other}).status_code == 404
