"""A calibration of two cameras, from the request to what it says of the rig."""

import copy
import json

import numpy as np
import pytest
from sqlalchemy import select

from apexcal.documents.results import FitResult
from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector
from apexcal.geometry.se3 import SE3, to_document
from service.platform.db.models import Calibration, CorrespondenceSet, Job, Result
from service.platform.jobs.claims import Lease, claim, finish
from service.platform.jobs.queue import retry
from service.platform.jobs.reaper import reap
from service.publications.actions import Grounds, publish
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.work import work
from tests.workers.solver.two_cameras import FRONT, LEFT, SIZE, walked
from workers.tasks import concluding
from workers.tasks.solving import solve

SCHEDULE = {"slots": 2, "population": 300, "generations": 15, "max_iterations": 25}
TRUE = to_document(FRONT.transform @ LEFT.transform.inverse())


def rig_document(known=TRUE, images=None):
    cameras = [
        {
            "name": mount.name,
            "frame": mount.name,
            "image_size": list(SIZE),
            "nominal": _sent(to_document(SE3(mount.name, "velodyne", FORWARD_LIDAR_TO_OPTICAL, np.zeros(3)))),
            "images": images if mount is LEFT else None,
        }
        for mount in (FRONT, LEFT)
    ]
    between = [{"transform": _sent(known), "std_deg": 0.1, "std_mm": 5.0}]
    return {"name": "roof", "lidar": {"frame": "velodyne"}, "cameras": cameras, "camera_transforms": between}


def _sent(transform):
    return transform | {"rotation": {"matrix": transform["rotation"]["matrix"]}}


def asked(api, known=TRUE, images=None, **request):
    """An engineer, and the id of their calibration of both cameras from one walk, every vertex marked in both."""
    fleet = api.fleet()
    engineer = api.member(fleet, "engineer")
    vehicle = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "car"}).json()["id"]
    rig = engineer.post(f"/vehicles/{vehicle}/rigs", rig_document(known, images))
    assert rig.status_code == 201, rig.text
    points, pixels = walked(5, 100)
    rng = np.random.default_rng(5)
    sets = []
    for mount, seen in zip((FRONT, LEFT), pixels, strict=True):
        rows = np.column_stack([points, seen + rng.normal(size=seen.shape)]).tolist()
        pairs = [dict(zip("xyzuv", row, strict=True)) | {"stamp_ns": 10**8 * n} for n, row in enumerate(rows)]
        sets.append(bring_pairs(engineer, rig.json()["id"], pairs, mount.name))
    body = {"models": ["pinhole"], "folds": 2, "schedule": SCHEDULE, "publish": "recommended"} | request
    return engineer, ask_calibration(engineer, vehicle, *sets, **body)


def test_two_cameras_are_compared_when_both_are_done(api, context):
    engineer, calibration = asked(api)
    work(context)
    done = engineer.get(f"/calibrations/{calibration}").json()
    assert (done["state"], done["problem"]) == ("done", None)
    (pair,) = done["summary"]["rig"]["pairs"]
    assert (pair["name"], pair["models"], pair["alarms"]) == ("T_front_left", ["pinhole", "pinhole"], [])
    np.testing.assert_allclose(pair["transform"]["translation_m"], TRUE["translation_m"], atol=0.15)
    assert [one["source"] for one in pair["stated"]] == ["nominal", "rig"]
    assert pair["stated"][1]["sigmas"] < 4.0
    assert pair["shared"]["vertices"] == 100
    assert [done["summary"]["cameras"][name]["published"] for name in ("front", "left")] == [True, True]
    assert conclusions(context) == [], "the last run concludes"
    result = engineer.get(f"/results/{done['summary']['cameras']['left']['models']['pinhole']['result_id']}").json()
    provenance = result["provenance"]
    assert (len(provenance["sources_sha256"]), len(provenance["pairs_sha256"])) == (64, 64)
    assert provenance["request"]["seed"] == result["seed"] == done["request"]["seed"]


def test_what_the_rig_states_is_of_the_cameras_before_their_images_are_rectified(api, context):
    R = rotation_from_vector(np.radians([0.6, -0.9, 0.5]))
    own = SE3("left", "velodyne", R.T @ LEFT.transform.R, R.T @ LEFT.transform.t)
    known = to_document(FRONT.transform @ own.inverse())
    engineer, calibration = asked(api, known, {"kind": "rectified", "rotation": {"matrix": R.tolist()}})
    work(context)
    (pair,) = engineer.get(f"/calibrations/{calibration}").json()["summary"]["rig"]["pairs"]
    assert pair["transform"]["from_frame"] == "left_rectified"
    assert [one["source"] for one in pair["stated"]] == ["nominal", "rig"] and pair["alarms"] == []
    assert pair["stated"][1]["sigmas"] < 4.0


def test_a_rig_that_states_something_else_is_an_alarm_that_publishes_nothing(api, context):
    wrong = copy.deepcopy(TRUE)
    wrong["translation_m"][0] += 1.0
    engineer, calibration = asked(api, wrong)
    work(context)
    summary = engineer.get(f"/calibrations/{calibration}").json()["summary"]
    (alarm,) = summary["rig"]["alarms"]
    assert "disagrees with what the rig states" in alarm
    for camera in ("front", "left"):
        assert summary["cameras"][camera]["published"] is False
        (check,) = (one for one in summary["cameras"][camera]["checks"] if one["name"] == "rig")
        assert (check["verdict"], check["sentence"]) == ("stop", alarm)


def solved_at_once(context, at_most=2):
    """Claims of the oldest runs, each with the function that writes its end: none ends before all are solved."""
    with context.database.reading() as session:
        of_runs = select(Job.id).where(Job.kind == "solve", Job.state == "queued").order_by(Job.id)
        ids = session.scalars(of_runs.limit(at_most)).all()
    ends = []
    for job_id in ids:
        held = claim(context.database, job_id, "w")
        with Lease(context.database, held) as lease:
            ends.append((held, solve(context, held, lease)))
    return ends


def conclusions(context):
    with context.database.reading() as session:
        return session.execute(select(Job.id, Job.queue, Job.state).where(Job.kind == "conclude")).all()


def test_a_cancel_before_the_conclusion_ends_the_calibration(api, context):
    engineer, calibration = asked(api, folds=0, farm="runs")
    for held, write in solved_at_once(context):
        finish(context.database, held, write)
    waiting = engineer.get(f"/calibrations/{calibration}").json()
    assert (waiting["state"], waiting["progress"]["message"]) == ("running", "the models are compared")
    ((job_id, queue, _),) = conclusions(context)
    assert queue == "report"
    assert engineer.post(f"/calibrations/{calibration}/cancel").status_code == 202
    reap(context.database, context.store)
    ended = engineer.get(f"/calibrations/{calibration}").json()
    assert (ended["state"], ended["summary"]) == ("cancelled", None)
    assert claim(context.database, job_id, "late") is None


def without_times(answer):
    """A calibration as answered, without ids, names of workers and times."""
    left_out = ("id", "seconds", "workers", "created_at", "finished_at", "seed", "result_id", "links")
    if isinstance(answer, dict):
        return {name: without_times(value) for name, value in answer.items() if name not in left_out}
    return [without_times(value) for value in answer] if isinstance(answer, list) else answer


def test_the_last_run_says_what_a_job_of_its_own_says(api, context):
    """Also where two runs end at the same moment, so that neither was the last when it was judged."""
    engineer, calibration = asked(api, farm="runs", publish="none", seed=3)
    work(context)
    assert conclusions(context) == []
    first = engineer.get(f"/calibrations/{calibration}").json()
    request = {name: first["request"][name] for name in ("models", "folds", "schedule", "farm", "publish", "seed")}
    with context.database.reading() as session:
        sets = [str(one) for one in session.scalars(select(CorrespondenceSet.id).order_by(CorrespondenceSet.id))]
    second = ask_calibration(engineer, first["vehicle_id"], *sets, **request)
    with context.database.reading() as session:
        runs = session.scalars(select(Job.id).where(Job.kind == "solve", Job.state == "queued")).all()
    ends = solved_at_once(context, len(runs))
    with context.database.writing() as session:
        row = ends[-1][1](session).result
        assert FitResult.model_validate_json(json.dumps(row["document"])) == row["fit"], "as read again"
        session.rollback()
    for held, write in ends:
        finish(context.database, held, write)
    assert [state for *_, state in conclusions(context)] == ["queued"]
    work(context)
    again = engineer.get(f"/calibrations/{second}").json()
    assert without_times(again["summary"]) == without_times(first["summary"])


@pytest.mark.parametrize("retried", [False, True])
def test_what_was_judged_beside_something_else_is_judged_again(api, context, retried):
    """Between the judging of the last run and its end another result is published, or a failed run is tried again."""
    engineer, calibration = asked(api, folds=0, farm="runs")
    ((first, write), (last, _)) = solved_at_once(context)
    if retried:
        finish(context.database, first, state="failed", problem={"code": "made", "detail": "Made.", "hint": "Wait."})
    else:
        finish(context.database, first, write)
    with Lease(context.database, last) as lease:
        write_last = solve(context, last, lease)
    if retried:
        with context.database.writing() as session:
            retry(session, first.job_id)
        assert engineer.get(f"/calibrations/{calibration}").json()["state"] == "running"
    else:
        with context.database.writing() as session:
            result = session.scalars(select(Result)).one()
            publish(session, session.get_one(Calibration, result.calibration_id), result, Grounds(None, "Now."))
    finish(context.database, last, write_last)
    assert len(conclusions(context)) == (0 if retried else 1)
    work(context)
    ended = engineer.get(f"/calibrations/{calibration}").json()
    assert (ended["state"], len(ended["summary"]["rig"]["pairs"])) == ("done", 1)


def test_a_judge_that_fails_leaves_what_the_run_came_to(api, context, monkeypatch):
    engineer, calibration = asked(api, folds=0, farm="runs")
    with monkeypatch.context() as broken:
        broken.setattr(concluding, "camera_summary", lambda fits: fits[len(fits)])
        work(context)
    failed = engineer.get(f"/calibrations/{calibration}").json()
    assert (failed["state"], failed["problem"]["code"]) == ("failed", "internal_error")
    with context.database.reading() as session:
        assert session.scalars(select(Result.verdict)).all() == [None, None]
    ((job_id, *_),) = conclusions(context)
    with context.database.writing() as session:
        retry(session, job_id)
    work(context)
    assert engineer.get(f"/calibrations/{calibration}").json()["state"] == "done"


def test_known_transforms_name_two_cameras_of_the_rig(fleet, engineer):
    vehicle = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "car"}).json()["id"]
    refused = engineer.post(f"/vehicles/{vehicle}/rigs", rig_document(TRUE | {"from_frame": "velodyne"}))
    assert (refused.status_code, refused.json()["code"]) == (422, "invalid_request")
    assert "camera_transforms[0] leads from 'velodyne' to 'front'" in refused.json()["detail"]
    made = engineer.post(f"/vehicles/{vehicle}/rigs", rig_document()).json()
    assert engineer.get(f"/rigs/{made['id']}").json()["camera_transforms"] == made["camera_transforms"]
    assert (made["camera_transforms"][0]["std_deg"], made["camera_transforms"][0]["std_mm"]) == (0.1, 5.0)
