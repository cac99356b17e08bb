"""What workers write of a validation is what its documents say, and what plain NumPy computes."""

import cv2
import numpy as np
import pytest

from apexcal.documents.validations import PairScore, RoadScore
from apexcal.geometry.se3 import to_document
from tests.support.asking import bring_pairs
from tests.support.databases import one_database
from tests.support.rows import LEVEL
from tests.support.scenes.drive import Drive, record
from tests.support.scenes.road import draw_road
from tests.support.work import work
from tests.workers.readers.making_recordings import PERIOD_NS, START_NS, clouds, compressed, interleaved, write_bag
from tests.workers.tasks.test_ingesting import uploaded
from tests.workers.validation.roads import camera
from workers.simulation.sensors import SENSORS

F, CX, CY = 420.0, 325.0, 236.0
K = [F, 0.0, CX, 0.0, F, CY, 0.0, 0.0, 1.0]
LENS = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "K": K, "D": []}


def errors_of(points, marks):
    """Distances, px, under the level mount of the seeded rig."""
    right, down, forward = -points[:, 1], -points[:, 2] - 0.1, points[:, 0] - 0.2
    return np.hypot(F * right / forward + CX - marks[:, 0], F * down / forward + CY - marks[:, 1])


def test_a_calibration_is_scored_on_pairs_that_it_never_saw(context, engineer, rig):
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(5, 20, 40), rng.uniform(-2, 2, 40), rng.uniform(-1, 1, 40)])
    marks = rng.uniform(100, 400, (40, 2))
    pairs = [dict(zip("xyzuv", row, strict=True)) for row in np.hstack([points, marks]).tolist()]
    body = {"kind": "pair_validation", "set_id": bring_pairs(engineer, rig.id, pairs)}
    body["calibration"] = {"lens": LENS, "transform": LEVEL}
    asked = engineer.post("/analyses", body)
    assert asked.status_code == 202, asked.text
    work(context)
    done = engineer.get(f"/analyses/{asked.json()['id']}").json()
    assert (done["state"], done["problem"]) == ("done", None)
    score = PairScore.model_validate(done["result"])
    assert not score.model_extra
    errors = errors_of(points, marks)
    assert (score.mean_px, score.max_px) == (pytest.approx(errors.mean()), pytest.approx(errors.max()))
    assert score.verdict == "unknown" and "states no standard deviations" in score.sentence


SIZE = (640, 480)  # of the seeded rig's camera


def bag_of_a_drive(path, frames=3, drive=Drive(speed_m_s=0.0)):
    """A ROS bag of a simulated road; the vehicle stands, and the sweeps' stamps are their frames'."""
    seen = record(draw_road(5), drive, SENSORS["os1-64"], camera(*SIZE), 5, frames)
    messages = []
    for number, (sweep, image) in enumerate(seen):
        columns = dict(zip("xyz", sweep.xyz.T, strict=True))
        columns |= {"intensity": sweep.intensity, "ring": sweep.ring, "time": np.zeros(len(sweep.ring))}
        ((topic, kind, _, _),) = clouds(1)
        stamp_ns = START_NS + number * PERIOD_NS
        messages.append((topic, kind, stamp_ns, next(clouds(1, columns))[3]))
        messages[-1][3].header.stamp.sec, messages[-1][3].header.stamp.nanosec = divmod(stamp_ns, 10**9)
        data = cv2.imencode(".jpg", image)[1].tobytes()
        message = compressed(stamp_ns, data)
        messages.append(("/camera/compressed", message.__msgtype__, stamp_ns, message))
    return write_bag(path, interleaved(messages))


@one_database
def test_a_drive_is_held_against_its_frames(context, tmp_path, engineer, rig):
    recording = uploaded(context, rig, bag_of_a_drive(tmp_path / "drive.bag"))
    work(context)
    truth = camera(*SIZE)
    K = [truth.intrinsics.get(name, 0.0) for name in ("f_x", "s", "c_x", "zero", "f_y", "c_y")] + [0.0, 0.0, 1.0]
    lens = {"width": SIZE[0], "height": SIZE[1], "distortion_model": "plumb_bob", "K": K, "D": []}
    transform = to_document(truth.T_camera_lidar)
    body = {"camera": "front", "recording_id": str(recording.id)}
    body["calibration"] = {"lens": lens, "transform": transform}
    kinds = ("lane_validation", "edge_validation")
    ids = {kind: engineer.post("/analyses", body | {"kind": kind}).json()["id"] for kind in kinds}
    lens |= {"width": 64, "height": 48}
    small = body | {"kind": "edge_validation", "calibration": {"lens": lens, "transform": transform}}
    refused = engineer.post("/analyses", small).json()["id"]
    work(context)
    for validation in ids.values():
        done = engineer.get(f"/analyses/{validation}").json()
        assert (done["state"], done["problem"]) == ("done", None)
        score = RoadScore.model_validate(done["result"])
        assert not score.model_extra
        assert (score.verdict, score.frames) == ("agrees", 3), score.sentence
    failed = engineer.get(f"/analyses/{refused}").json()
    assert (failed["state"], failed["problem"]["code"]) == ("failed", "image_size_differs")
