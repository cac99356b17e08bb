"""The machine's marks of a rendered recording, from frames in the store to pairs."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from apexcal.documents.pairs import MACHINE, MARK_SIGMA
from benchmarks.marks.draws import Draw
from benchmarks.marks.scenes import Scene
from service.platform.db.analyses import AnalysisFile
from service.platform.db.annotations import CropPage, Disclosure
from service.platform.db.base import new_id
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from service.platform.db.recordings import CameraFrame, Recording, Sensor
from tests.service.detections.seeding import seed_corners, seed_rig
from tests.support.databases import one_database
from tests.support.rows import HEIGHT, WIDTH
from tests.support.work import work
from tests.workers.readers.making_recordings import PERIOD_NS, START_NS, clouds, compressed, interleaved, write_bag
from tests.workers.tasks.test_ingesting import uploaded
from workers.readers.images.deep_images import shown_levels

DRAW = Draw(
    seed=4242, size=(WIDTH, HEIGHT), model="pinhole", lens_stated=True, still=True, count=14, board_m=(0.6, 0.9),
    size_stated=True, pattern="plain", contrast=70.0, texture=5.0, blur_px=0.8, noise=1.5, motion_ms=0.0,
    head_above_m=0.0, second="none", gain_step=1.0, tip_outside=False, thermal=False,
)  # fmt: skip

LEVEL = replace(DRAW, thermal=True, contrast=40.0, upper_corner=1)


def bag_of(scene, path):
    frames = []
    for index in range(len(scene)):
        stamp_ns = START_NS + index * PERIOD_NS
        message = compressed(stamp_ns, cv2.imencode(".png", scene[index])[1].tobytes())
        frames.append(("/camera/compressed", message.__msgtype__, stamp_ns, message))
    return write_bag(path, interleaved(clouds(len(scene)), frames))


def seed_sights(database, recording, scene):
    """A finished detection with what the scene's LiDAR says; the camera states its lens. Returns its id."""
    f_x, f_y, c_x, c_y = scene.camera.lens.intrinsics[:4].tolist()
    K = [f_x, 0.0, c_x, 0.0, f_y, c_y, 0.0, 0.0, 1.0]
    lens = {"model": "brown_conrady", "K": K, "D": [0.0] * 5, "width": WIDTH, "height": HEIGHT}
    with database.writing() as session:
        camera = session.query(Sensor).filter_by(recording_id=recording.id, kind="camera").one()
        camera.facts = {**(camera.facts or {}), "camera_info": lens}
        assert session.query(CameraFrame).filter_by(sensor_id=camera.id).count() == len(scene)
        lidar = session.query(Sensor).filter_by(recording_id=recording.id, kind="lidar").one()
        detection = Detection(
            fleet_id=recording.fleet_id, recording_id=recording.id, lidar_id=lidar.id,
            region={"all": [{"quantity": "x", "op": ">", "value": 0.0}]},
            detector="refined", options={"upper_corner": scene.drawn.upper_corner},
            pairing={"mode": "nearest", "offset_ns": 0, "max_gap_ns": 50_000_000},
            content_hash="0" * 64, state="done", remaining=0,
            counts={"roll": {"mean_deg": 45.0 * scene.drawn.upper_corner}},
        )  # fmt: skip
        session.add(detection)
        session.flush()
        for index, sight in enumerate(scene.sights):
            (x, y, z), apex, vertex = sight.corners["top"].tolist(), new_id(), new_id()
            session.add(Apex(id=apex, recording_id=recording.id, lidar_id=lidar.id, sweep_index=index, x=x, y=y, z=z))
            session.flush()
            session.add(
                Vertex(
                    id=vertex, detection_id=detection.id, lidar_id=lidar.id, apex_id=apex, rank=index,
                    sweep_index=index,
                    time_ns=START_NS + index * PERIOD_NS, x=x, y=y, z=z, ring=3, points=50,
                )
            )  # fmt: skip
            session.flush()
            session.add(VertexFrame(vertex_id=vertex, sensor_id=camera.id, frame_index=index, gap_ns=0))

    def offsets_of(sweep):
        corners = scene.sights[sweep].corners
        return {name: (xyz - corners["top"]).tolist() for name, xyz in corners.items() if name != "top"}

    seed_corners(database, detection.id, offsets_of)
    return detection.id


@one_database
@pytest.mark.parametrize("draw", [DRAW, LEVEL], ids=["grey", "16 bits, level"])
def test_the_machine_marks_a_detection_and_its_marks_become_pairs(api, context, tmp_path, fleet, draw):
    engineer, annotator = api.member(fleet, "engineer"), api.member(fleet, "annotator")
    scene = Scene(draw)
    recording = uploaded(context, seed_rig(api.database, fleet), bag_of(scene, tmp_path / "walk.bag"))
    work(context)
    detection_id = seed_sights(api.database, recording, scene)
    taken_before = taken_bytes(api.database, recording.id)
    sets = f"/detections/{detection_id}/correspondence-sets"
    unmarked = engineer.post(sets, {"camera": "front", "machine_marks": True})
    assert (unmarked.status_code, unmarked.json()["code"]) == (409, "nothing_marked")
    request = {"kind": "machine_marks", "detection_id": str(detection_id), "camera": "front"}
    asked = engineer.post("/analyses", request)
    assert asked.status_code == 202, asked.text
    path = f"/analyses/{asked.json()['id']}"
    assert engineer.get(f"{path}/marks").json()["code"] == "no_marks"
    work(context)
    done = engineer.get(path).json()
    assert (done["state"], done["problem"], done["camera"]) == ("done", None, "front")
    facts = done["result"]
    assert set(facts) == {"corners", "marked", "reasons", "refusal", "sigma_px", "clock_offset_ms", "warning"}
    assert (facts["corners"], facts["refusal"], facts["clock_offset_ms"]) == (len(scene), None, None)
    assert facts["marked"] >= 0.7 * len(scene)
    # The rig's camera looks ahead, the scene's LiDAR is turned.
    assert "looks 108 degrees to the right of the LiDAR's x axis" in facts["warning"]
    assert facts["marked"] + sum(facts["reasons"].values()) == len(scene)

    assert annotator.get(f"{path}/marks").status_code == 403
    marks = engineer.get(f"{path}/marks").json()["marks"]
    with api.database.reading() as session:
        index_of = {str(vertex.id): vertex.sweep_index for vertex in session.query(Vertex)}
        assert {row.corner for row in session.query(Disclosure)} == {"top"}, "nothing was told of the other corners"
    marked = [mark for mark in marks if mark["reason"] is None]
    off = np.array([[mark["u"], mark["v"]] - scene.truth["top"][index_of[mark["vertex_id"]]] for mark in marked])
    assert len(marked) == facts["marked"] and np.median(np.hypot(*off.T)) < 0.4
    assert all(0.0 < mark["sigma_u"] < 3.0 for mark in marked)

    without = engineer.post(sets, {"camera": "front"})
    assert (without.status_code, without.json()["code"]) == (409, "nothing_marked")
    made = engineer.post(sets, {"camera": "front", "machine_marks": True}).json()
    assert made["count"] == facts["marked"]
    assert f"{made['count']} of {made['count']} marks are the machine's." in made["notes"]
    pairs = engineer.get(f"/correspondence-sets/{made['id']}").json()["pairs"]
    assert all(pair[MACHINE] and 0.0 < pair[MARK_SIGMA] < 3.0 for pair in pairs)
    assert {(pair["u"], pair["v"]) for pair in pairs} == {(mark["u"], mark["v"]) for mark in marked}
    crops_show_the_frames_around_the_marks(annotator, f"/detections/{detection_id}", scene, index_of)

    assert taken_bytes(api.database, recording.id) > taken_before, "the tiles count to the fleet's quota"
    assert engineer.delete(f"/detections/{detection_id}").status_code == 204
    assert taken_bytes(api.database, recording.id) == taken_before
    with api.database.reading() as session:
        assert not session.query(AnalysisFile).count() and not session.query(CropPage).count()


def taken_bytes(database, recording_id):
    with database.reading() as session:
        return session.get_one(Recording, recording_id).taken_bytes


def crops_show_the_frames_around_the_marks(annotator, detection, scene, index_of):
    """Some are marked blind; then each crop's picture is the piece of its frame that it says it is."""
    where = f"{detection}/crops?camera=front"
    while annotator.get(where).json()["blind_needed"]:
        task = annotator.post(f"{detection}/tasks/next", {"camera": "front"}).json()
        u, v = scene.truth["top"][index_of[task["vertex"]["id"]]].tolist()
        answer = {"id": str(new_id()), "version": 0, "verdict": "confirmed", "mark": {"u": u, "v": v}}
        assert annotator.post(f"/tasks/{task['task_id']}/answer", answer).status_code == 200
    page = annotator.post(f"{detection}/crops/next", {"camera": "front"}).json()
    assert len(page["crops"]) >= 6
    for index, crop in enumerate(page["crops"]):
        image, reach = crop["image"], 0.5 * crop["side_px"]
        assert image["url"] == f"/v1/crop-pages/{page['id']}/crops/{index}"
        assert max(image["width"], image["height"]) <= 2.0 * crop["side_px"] + 3
        for axis, length, size in (("u", image["width"], WIDTH), ("v", image["height"], HEIGHT)):
            assert image[axis] <= max(0.0, crop[axis] - reach)
            assert image[axis] + length >= min(size, crop[axis] + reach), "the crop lies inside its picture"
        answer = annotator.get(image["url"].removeprefix("/v1"))
        assert (answer.status_code, answer.headers["content-type"]) == (200, "image/png")
        piece = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)
        rows = slice(image["v"], image["v"] + image["height"])
        columns = slice(image["u"], image["u"] + image["width"])
        frame = scene[crop["frame_index"]]
        shown = shown_levels(frame) if frame.dtype == np.uint16 else frame
        # In colour as people see it, so a grey frame's channels are alike.
        for channel in np.moveaxis(np.atleast_3d(piece), 2, 0):
            np.testing.assert_array_equal(channel, shown[rows, columns])
    answer = annotator.get(f"/crop-pages/{page['id']}/crops/99")
    assert (answer.status_code, answer.json()["code"]) == (404, "no_such_crop")
