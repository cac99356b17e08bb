"""Lane markers and depth edges against frames: on simulated roads, and on real ones where they are."""

import json

import cv2
import numpy as np
import pytest
import yaml

from apexcal.documents.validations import RoadScore
from tests.support.places import DATA
from tests.workers.validation.roads import checked, drive
from workers.readers.recording import Sweep
from workers.readers.trees.pcd import read_pcd
from workers.validation.calibration import KnownCalibration
from workers.validation.edge_check import EdgeCheck
from workers.validation.lane_check import LaneCheck

KNOCK_DEG = 0.25


@pytest.mark.parametrize("kind", [LaneCheck, EdgeCheck])
def test_a_sound_mount_agrees_and_a_knocked_one_is_named_with_its_turn(kind):
    sound = checked(kind, drive(5))
    assert sound["verdict"] == "agrees", sound["sentence"]
    assert np.hypot(sound["yaw_deg"], sound["pitch_deg"]) < 0.1
    for pitch, yaw in ((KNOCK_DEG, 0.0), (0.0, -KNOCK_DEG)):
        found = checked(kind, drive(5), (pitch, yaw, 0.0))
        assert found["verdict"] == "disagrees", found["sentence"]
        # The peak is where the knock is taken back.
        assert found["yaw_deg"] == pytest.approx(-yaw, abs=0.1)
        assert found["pitch_deg"] == pytest.approx(-pitch, abs=0.1)


@pytest.mark.parametrize("kind", [LaneCheck, EdgeCheck])
def test_the_document_has_all_that_a_check_says(kind):
    found = checked(kind, drive(5))
    score = RoadScore.model_validate(found)
    assert not score.model_extra
    assert score.score is not None and score.score_at_one_degree is not None
    yaw = next(curve for curve in score.curves if curve.offset == "yaw")
    assert yaw.score[yaw.at.index(0.0)] == pytest.approx(score.score, abs=1e-3)
    assert max(yaw.score[yaw.at.index(1.0)], yaw.score[yaw.at.index(-1.0)]) == pytest.approx(
        score.score_at_one_degree, abs=1e-3
    )
    assert score.score > 1.2 * score.score_at_one_degree


def test_a_road_without_paint_or_without_things_shows_nothing():
    assert checked(EdgeCheck, drive(7, 3, is_empty=True, is_painted=False))["verdict"] == "unknown"
    bare = checked(LaneCheck, drive(7, 3, is_empty=True, is_painted=False))
    assert (bare["verdict"], bare["score"]) == ("unknown", None)


def test_frames_of_another_place_show_nothing():
    strange = [(sweep, image) for (sweep, _), (_, image) in zip(drive(5), drive(6), strict=True)]
    assert checked(EdgeCheck, strange)["verdict"] == "unknown"


def sweep_of(file, *, from_top):
    cloud = read_pcd(file.read_bytes(), file.name)
    xyz = np.column_stack([cloud[axis] for axis in "xyz"]).astype(np.float32)
    there = np.isfinite(xyz).all(axis=1) & np.any(xyz != 0.0, axis=1)
    ring = cloud["ring"][there].astype(np.int64)
    ring = ring.max() - ring if from_top else ring
    count = int(there.sum())
    intensity = cloud["intensity"][there].astype(np.float32)
    return Sweep(0, xyz[there], intensity, ring.astype(np.uint16), np.zeros(count, np.int64))


def published(K, D, T, size):
    lens = {"model": "brown_conrady", "f_x": K[0][0], "f_y": K[1][1], "c_x": K[0][2], "c_y": K[1][2]}
    lens |= dict(zip(("k1", "k2", "k3", "k4", "k5"), D, strict=True)) | {"image_size": size}
    U, _, Vt = np.linalg.svd(np.array(T)[:3, :3])
    mount = {"to_frame": "camera", "from_frame": "lidar", "rotation": {"matrix": (U @ Vt).tolist()}}
    mount["translation_m"] = [row[3] for row in T[:3]]
    return KnownCalibration.of({"intrinsics": lens, "transform": mount})


def test_the_published_mount_of_a_real_road_scores_far_more_than_a_degree_away():
    folder = DATA / "road-lane-markers"
    if not folder.exists():
        pytest.skip("real data is not here: ../shared/data/road-lane-markers")
    lens = json.loads((folder / "center_camera-intrinsic.json").read_text())["center_camera-intrinsic"]["param"]
    name = "top_center_lidar-to-center_camera-extrinsic"
    mount = json.loads((folder / f"{name}.json").read_text())[name]["param"]["sensor_calib"]["data"]
    known = published(lens["cam_K"]["data"], lens["cam_dist"]["data"][0], mount, [1920, 1200])
    check = LaneCheck(known)
    check.add(sweep_of(folder / "calib.pcd", from_top=False), cv2.imread(str(folder / "calib.png")))
    found = check.result()
    assert found["verdict"] == "agrees", found["sentence"]
    assert found["score"] > 3.0 * found["score_at_one_degree"]
    assert found["score"] > 10.0 * found["chance"]
    assert np.hypot(found["yaw_deg"], found["pitch_deg"]) < 0.25


def test_a_knock_shows_on_real_edges():
    folder = DATA / "os1-64-board"
    if not folder.exists():
        pytest.skip("real data is not here: ../shared/data/os1-64-board")
    stated = yaml.safe_load((folder / "camera.yaml").read_text())
    mount = published(np.reshape(stated["K"], (3, 3)), stated["D"], stated["T_camera_lidar"], [1920, 1200])
    seen = [
        (
            sweep_of(folder / "clouds" / f"{number}.pcd", from_top=True),
            cv2.imread(str(folder / "images" / f"{number}.jpg"), cv2.IMREAD_REDUCED_GRAYSCALE_2),
        )
        for number in range(0, 24, 2)
    ]

    def turned(pitch, yaw):
        check = EdgeCheck(mount.moved(np.array([pitch, yaw, 0.0]), np.zeros(3)))
        for sweep, image in seen:
            check.add(sweep, image)
        return check.result()

    as_published = turned(0.0, 0.0)
    pitch, yaw = as_published["pitch_deg"], as_published["yaw_deg"]
    assert turned(pitch, yaw)["verdict"] == "agrees"
    for side in (-KNOCK_DEG, KNOCK_DEG):
        knocked = turned(pitch, yaw + side)
        assert knocked["verdict"] == "disagrees", knocked["sentence"]
        assert knocked["yaw_deg"] == pytest.approx(-side, abs=0.1)
