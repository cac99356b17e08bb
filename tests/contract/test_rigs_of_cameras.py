"""A calibration of two cameras, from the request to what it says of the rig."""

import copy

import numpy as np
import pytest
from sqlalchemy import select

from apexcal.geometry.rotations import FORWARD_LIDAR_TO_OPTICAL, rotation_from_vector
from apexcal.geometry.se3 import SE3, to_document
from service.platform.db.models import Job
from service.platform.jobs.claims import claim
from service.platform.jobs.sweep import sweep
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.work import work
from tests.workers.solver.two_cameras import FRONT, LEFT, SIZE, walked
from workers.tasks.running import run_job

pytestmark = pytest.mark.usefixtures("broker")
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
    with api.database.reading() as session:
        assert session.scalars(select(Job.queue).where(Job.kind == "conclude")).all() == ["report"]
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
    assert "from what the rig states" in alarm and "noise does not explain" in alarm
    for camera in ("front", "left"):
        assert summary["cameras"][camera]["published"] is False
        (check,) = (one for one in summary["cameras"][camera]["checks"] if one["name"] == "rig")
        assert (check["verdict"], check["sentence"]) == ("stop", alarm)


def at_the_conclusion(api, context):
    """An engineer, the calibration, and the job that concludes it, not yet claimed."""
    engineer, calibration = asked(api, folds=0, farm="runs")
    with api.database.reading() as session:
        ids = session.scalars(select(Job.id).order_by(Job.id)).all()
    for job_id in ids:
        run_job(context, job_id)
    waiting = engineer.get(f"/calibrations/{calibration}").json()
    assert (waiting["state"], waiting["progress"]["message"]) == ("running", "the models are compared")
    with api.database.reading() as session:
        (job_id,) = session.scalars(select(Job.id).where(Job.kind == "conclude"))
    return engineer, calibration, job_id


def test_a_cancel_before_the_conclusion_ends_the_calibration(api, context):
    engineer, calibration, job_id = at_the_conclusion(api, context)
    assert engineer.post(f"/calibrations/{calibration}/cancel").status_code == 202
    sweep(context.database, context.store)
    ended = engineer.get(f"/calibrations/{calibration}").json()
    assert (ended["state"], ended["summary"]) == ("cancelled", None)
    assert claim(context.database, job_id, "late") is None


def test_known_transforms_name_two_cameras_of_the_rig(fleet, engineer):
    vehicle = engineer.post(f"/fleets/{fleet}/vehicles", {"name": "car"}).json()["id"]
    refused = engineer.post(f"/vehicles/{vehicle}/rigs", rig_document(TRUE | {"from_frame": "velodyne"}))
    assert (refused.status_code, refused.json()["code"]) == (422, "invalid_request")
    assert "camera_transforms[0] leads from 'velodyne' to 'front'" in refused.json()["detail"]
    made = engineer.post(f"/vehicles/{vehicle}/rigs", rig_document()).json()
    assert engineer.get(f"/rigs/{made['id']}").json()["camera_transforms"] == made["camera_transforms"]
    assert (made["camera_transforms"][0]["std_deg"], made["camera_transforms"][0]["std_mm"]) == (0.1, 5.0)
