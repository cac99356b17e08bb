"""What the service writes is what the workers work on: a calibration from the request to the current calibration."""

import numpy as np
import pytest
from sqlalchemy import select

from apexcal.documents.calibrations import CalibrationView
from apexcal.documents.published_calibrations import CurrentCalibration
from apexcal.documents.results import ResultView
from service.platform.db.jobs import Job
from service.platform.jobs.reaper import reap
from tests.support.asking import ask_calibration, bring_pairs
from tests.support.work import work
from tests.workers.solver.few_pairs import drawn
from workers.geometry.models import EXTRINSICS
from workers.tasks.running import run_job

SCHEDULE = {"population": 200, "generations": 12, "max_iterations": 6, "slots": 2}
F, CX, CY = 420.0, 325.0, 236.0


def pairs_of_a_pinhole():
    """80 pairs of a level camera in 20 poses over its whole image, with half a pixel of noise."""
    rng = np.random.default_rng(3)
    pairs = []
    for pose in range(20):
        u, v, x = rng.uniform((40, 40, 4), (2 * CX - 40, 2 * CY - 40, 12))
        y, z = (CX - u) * x / F, (CY - v) * x / F
        for _ in range(4):
            p = np.array([x, y, z]) + rng.uniform(-0.4, 0.4, 3)
            camera = np.array([-p[1], -p[2] - 0.1, p[0] - 0.2])
            u, v = F * camera[:2] / camera[2] + (CX, CY) + rng.normal(0, 0.5, 2)
            pairs.append({"x": p[0], "y": p[1], "z": p[2], "u": u, "v": v, "group": pose})
    return pairs


def test_workers_finish_what_was_asked_the_same_way_however_it_is_farmed(context, engineer, rig):
    brought = bring_pairs(engineer, rig.id, pairs_of_a_pinhole())
    found = {}
    for farm in ("slots", "runs"):
        body = {"models": ["pinhole"], "folds": 2, "schedule": SCHEDULE, "farm": farm, "publish": "recommended"}
        asked = ask_calibration(engineer, rig.vehicle_id, brought, **body)
        work(context)
        answer = engineer.get(f"/calibrations/{asked}")
        CalibrationView.model_validate_json(answer.content, extra="forbid")
        done = answer.json()
        assert (done["state"], done["problem"]) == ("done", None)
        assert done["progress"]["fraction"] == 1.0
        summary = done["summary"]["cameras"]["front"]["models"]["pinhole"]
        answer = engineer.get(f"/results/{summary['result_id']}")
        ResultView.model_validate_json(answer.content, extra="forbid")
        found[farm] = answer.json()
        assert summary["heldout_mean_px"] < 1.5
        slots = engineer.get(f"/calibrations/{done['id']}/slots?fold=-1&limit=1000").json()["items"]
        assert len(slots) == 2 * found[farm]["iterations"]
        answer = engineer.get(f"/vehicles/{rig.vehicle_id}/cameras/front/calibration")
        CurrentCalibration.model_validate_json(answer.content, extra="forbid")
        current = answer.json()
        assert current["result_id"] == summary["result_id"]
        assert current["intrinsics"] == found[farm]["intrinsics"]
    for key in ("ga", "polished", "intrinsics", "transform", "seed", "history"):
        assert found["slots"][key] == found["runs"][key], key
    assert set(EXTRINSICS["rotation_vector"]) <= set(found["runs"]["ga"]["parameters"])
    assert found["runs"]["intrinsics"]["f_x"] == pytest.approx(F, rel=0.05)


def test_a_cancelled_calibration_ends_as_cancelled(api, context, engineer, rig):
    brought = bring_pairs(engineer, rig.id, pairs_of_a_pinhole())
    body = {"models": ["pinhole"], "folds": 0, "schedule": SCHEDULE, "farm": "slots"}
    asked = ask_calibration(engineer, rig.vehicle_id, brought, **body)
    with api.database.reading() as session:
        first = session.scalars(select(Job.id).order_by(Job.id)).first()
    run_job(context, first)
    engineer.post(f"/calibrations/{asked}/cancel")
    reap(context.database, context.store)
    work(context)
    ended = engineer.get(f"/calibrations/{asked}").json()
    assert ended["state"] == "cancelled", (ended["problem"], ended["runs"])
    assert [run["state"] for run in ended["runs"]] == ["cancelled"]


@pytest.mark.parametrize("seed", [13, 16], ids=["behind the camera", "few poses"])
def test_pairs_that_tell_little_are_solved_stored_read_and_reported(context, seed, engineer, rig):
    document, columns = drawn(seed)
    pairs = [dict(zip("xyzuv", row, strict=True)) for row in zip(*(columns[name] for name in "xyzuv"), strict=True)]
    pairs = [pair | {"group": index // 6} for index, pair in enumerate(pairs)]
    brought = bring_pairs(engineer, rig.id, pairs)
    lens = {"f_x": 400.0, "f_y": 400.0, "c_x": 320.0, "c_y": 240.0}
    body = {"models": ["pinhole"], "folds": 2, "schedule": document["schedule"], "locked": lens}
    asked = ask_calibration(engineer, rig.vehicle_id, brought, **body)
    work(context)
    done = engineer.get(f"/calibrations/{asked}").json()
    assert (done["state"], done["problem"]) == ("done", None)
    result_id = done["summary"]["cameras"]["front"]["models"]["pinhole"]["result_id"]
    found = ResultView.model_validate_json(engineer.get(f"/results/{result_id}").content, extra="forbid")
    assert found.lens == "stated"
    asked = engineer.post("/analyses", {"kind": "report", "result_id": result_id})
    assert asked.status_code == 202, asked.text
    work(context)
    report = engineer.get(f"/analyses/{asked.json()['id']}/file")
    assert report.status_code == 200, report.text
