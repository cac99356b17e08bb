"""Results, their slots and publication, and the current calibration at its one address."""

from itertools import product

import numpy as np
import pytest
from sqlalchemy import update

from apexcal.geometry.se3 import from_document, to_document
from service.platform.db.base import new_id
from service.platform.db.calibrations import Calibration, CalibrationRun, CorrespondenceSet, Result, Slot
from service.platform.db.fleets import Rig
from tests.service.detections.seeding import seed_rig
from tests.support.results import ENDED, fit_result, model_summary, of_block, summary
from tests.support.rows import LEVEL, add

T_VEHICLE_LIDAR = {
    "to_frame": "base_link",
    "from_frame": "velodyne",
    "rotation": {"quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    "translation_m": [1.0, 0.0, 2.0],
}
PLACES = {"x": [5.0] * 60, "y": [0.0] * 60, "z": [0.0] * 60}
DOCUMENT = fit_result(
    pairs=60,
    polished=ENDED | {"mean_px": 1.25, "rms_px": 1.5},
    intrinsics={"model": "pinhole", "f_x": 500.0, "f_y": 501.0, "c_x": 320.0, "c_y": 240.0, "image_size": [640, 480]},
    transform=to_document(from_document(LEVEL)),
    std={"t_x": 0.01},
    covariance={"names": ["t_x"], "units": ["m"], "matrix": [[0.0001]]},
)
# What the end of a calibration says of the model.
FOUND = model_summary(new_id(), DOCUMENT, heldout_mean_px=0.9, heldout_rms_px=1.1)


@pytest.fixture
def rig(api, fleet):
    return seed_rig(api.database, fleet, T_vehicle_lidar=T_VEHICLE_LIDAR)


EDGE = "pinhole lies on the edge of its bounds (f_x, k1)."
ON_BOUNDS = FOUND | {
    "checks": [
        {
            "name": "bounds", "title": "Bounds", "verdict": "stop", "sentence": EDGE, "remedy": "Widen them.",
            "figures": {}, "scope": "mount_with_lens",
        }
    ]
}  # fmt: skip
NEWER = "Another calibration became the vehicle's current one since this result was judged."


def failed(document):
    """The sentences of the checks that a result, or a refusal, says are not passed."""
    return [one["sentence"] for one in document["checks"] if one["verdict"] in ("look", "stop")]


def seed_results(api, rig, folds=(-1, 0), found=FOUND):
    """A finished calibration with a result for each fold, and two slots a run."""
    checks = found.get("checks", [])
    verdict = checks[0]["verdict"] if checks else "pass"
    with api.database.writing() as session:
        marked = {"u": [10.0, 320.0, 630.0], "v": [20.0, 240.0, 470.0]} | PLACES
        pairs = session.query(CorrespondenceSet).order_by(CorrespondenceSet.id).first() or add(
            session, CorrespondenceSet, rig, count=60, notes=[], pairs=marked
        )
        calibration = add(session, Calibration, rig, summary=summary({"pinhole": found}))
        results = []
        for fold in folds:
            ended = {"state": "done", "iteration": 1, "search_state": {"best_loss": 1.5}}
            run = add(session, CalibrationRun, calibration, pairs, fold=fold, fit_request={"seed": 5}, **ended)
            judged = {"checks": checks, "verdict": verdict} if fold == -1 else {}
            results.append(add(session, Result, run, fold=fold, document=DOCUMENT, **judged).id)
            for iteration, slot in product(range(2), range(2)):
                best = {"loss": 1.5 + slot, "parameters": [0.0, 1.0], "evaluations": 24000}
                add(session, Slot, run, iteration=iteration, slot=slot, **best, worker=f"worker-{slot}")
        return calibration.id, results


def current_address(rig):
    return f"/vehicles/{rig.vehicle_id}/cameras/front/calibration"


@pytest.mark.parametrize(("source", "seen"), [("annotations", False), ("import", True)])
def test_single_pairs_of_marks_are_for_reviewers(api, fleet, rig, source, seen):
    _, (full, held) = seed_results(api, rig)
    columns = {"stamp_ns": [5, 6], "frame_index": [8, 9], "u": [1.5, 2.5], "v": [3.5, 4.5], "x": [0.0, 0.0]}
    outlier = {"index": 1, "residual_px": 30.0, "score": 9.0, "reason": "30 px right.", "excluded": False}
    single = {"residuals_px": [1.0, 30.5], "heldout": of_block([31.5], [1]), "outliers": [outlier]}
    with api.database.writing() as session:
        session.execute(update(CorrespondenceSet).values(pairs=columns, source=source))
        session.execute(update(Result).values(document=DOCUMENT | single))
    place = {"stamp_ns": 6, "frame_index": 9, "u": 2.5, "v": 4.5}
    for role, sees in (("viewer", seen), ("annotator", seen), ("reviewer", True)):
        read = api.member(fleet, role).get(f"/results/{full}")
        if sees:
            assert read.json()["outliers"] == [outlier | {"pair": place}]
            assert read.json()["residuals_px"] == [1.0, 30.5]
        else:
            assert read.json()["outliers"] == []
            assert read.json()["residuals_px"] is None
            assert not [text for text in ("30.5", "30 px", "31.5") if text in read.text]
            shown = {name: value for name, value in read.json()["heldout"].items() if value is not None}
            assert shown == {"mean_px": 1.0, "rms_px": 1.0, "forbidden": 0}
    of_fold = api.member(fleet, "reviewer").get(f"/results/{held}").json()
    assert of_fold["outliers"] == [outlier], "its indices are into what the fold left"
    assert of_fold["recording_id"] is None


def test_slots_come_in_pages_and_by_fit(api, fleet, rig, viewer):
    calibration, _ = seed_results(api, rig)
    found, after = [], ""
    while True:
        page = viewer.get(f"/calibrations/{calibration}/slots?limit=3{after}").json()
        found += page["items"]
        if page["next"] is None:
            break
        after = f"&after={page['next']}"
    assert [(slot["fold"], slot["iteration"], slot["slot"]) for slot in found] == [
        (fold, iteration, slot) for fold in (-1, 0) for iteration in range(2) for slot in range(2)
    ]
    assert found[1]["worker"] == "worker-1"
    assert found[1]["parameters"] == [0.0, 1.0]
    one = viewer.get(f"/calibrations/{calibration}/slots?camera=front&model=pinhole&fold=0").json()["items"]
    assert one == found[4:]
    assert viewer.get(f"/calibrations/{calibration}/slots?model=kannala_brandt").json()["items"] == []
    assert viewer.get(f"/calibrations/{calibration}/slots?after=x").json()["code"] == "invalid_cursor"
    read = viewer.get(f"/calibrations/{calibration}").json()
    assert [run["best_loss"] for run in read["runs"]] == [1.5, 1.5]
    assert read["progress"] == {"fraction": 1.0, "message": "2 of 2 fits have ended"}


def test_a_published_result_is_current_with_both_transforms(api, fleet, rig, viewer):
    calibration, (full, _) = seed_results(api, rig)
    published = api.member(fleet, "reviewer").post(f"/results/{full}/publication", {})
    assert published.status_code == 201
    answer = viewer.get(current_address(rig))
    current = answer.json()
    assert (current["result_id"], current["calibration_id"]) == (str(full), str(calibration))
    assert (current["model"], current["intrinsics"]) == ("pinhole", DOCUMENT["intrinsics"])
    T = current["T_camera_lidar"]
    assert {name: T[name] for name in ("to_frame", "from_frame", "translation_m")} == {
        name: LEVEL[name] for name in ("to_frame", "from_frame", "translation_m")
    }
    assert T["rotation"]["matrix"] == LEVEL["rotation"]["matrix"]
    T = current["T_vehicle_camera"]
    assert (T["to_frame"], T["from_frame"]) == ("base_link", "camera_front_optical")
    # The camera stands where the LiDAR does, plus what its nominal translation says in the LiDAR's axes.
    np.testing.assert_allclose(T["translation_m"], [1.2, 0.0, 1.9], atol=1e-12)
    np.testing.assert_allclose(T["rotation"]["matrix"], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    assert current["quality"]["mean_px"] == 1.25
    assert current["quality"]["heldout_mean_px"] == 0.9
    assert viewer.get(current_address(rig), headers={"If-None-Match": answer.headers["etag"]}).status_code == 304


def test_a_rig_without_a_vehicle_frame_gives_none(api, fleet, rig, reviewer):
    with api.database.writing() as session:
        session.get_one(Rig, rig.id).lidar.T_vehicle_lidar = None
    _, (full, _) = seed_results(api, rig)
    reviewer.post(f"/results/{full}/publication")
    assert "T_vehicle_camera" not in reviewer.get(current_address(rig)).json()


def test_only_fits_to_all_pairs_are_published(api, fleet, rig):
    _, (_, held) = seed_results(api, rig)
    refused = api.member(fleet, "reviewer").post(f"/results/{held}/publication")
    assert (refused.status_code, refused.json()["code"]) == (409, "not_publishable")


@pytest.mark.parametrize(
    ("query", "code"),
    [
        ("camera=%00", "invalid_request"),
        ("model=%00", "invalid_request"),
        ("after=RUN.99999999999999999999999.1", "invalid_cursor"),
        ("after=RUN.1.2147483648", "invalid_cursor"),
        ("after=RUN.-1.1", "invalid_cursor"),
    ],
)
def test_strange_queries_for_slots_are_refused(api, fleet, rig, query, code):
    calibration, _ = seed_results(api, rig)
    query = query.replace("RUN", rig.id.hex)
    answer = api.member(fleet, "viewer").get(f"/calibrations/{calibration}/slots?{query}")
    assert (answer.status_code, answer.json()["code"]) == (422, code)
