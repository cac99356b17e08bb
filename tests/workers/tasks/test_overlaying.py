"""Overlays: asked for over HTTP, drawn by a worker through a result's lens, and read as a PNG."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from sqlalchemy import func, select

from service.platform.db.calibrations import CorrespondenceSet, Result
from service.platform.db.detections import Apex, Detection, Vertex, VertexFrame
from service.platform.db.models import Blob, Disclosure, Fleet, Recording, Sensor, Study, Verdict
from service.platform.jobs.sweep import sweep
from tests.service.calibrations.test_results import DOCUMENT, seed_results
from tests.service.detections.seeding import LEVEL, seed_rig
from tests.service.publications.given import another_rig
from tests.support.databases import one_database
from tests.support.work import work
from tests.workers.readers.making_recordings import START_NS, clouds, images, interleaved, png, scene, write_bag
from tests.workers.tasks.test_ingesting import uploaded
from workers.tasks.context import Context

pytestmark = one_database
SIZE = (640, 480)
# The camera stands half a metre to the left of the LiDAR, so that the panel hides a part of the wall.
ASIDE = LEVEL | {"translation_m": [0.5, 0.0, 0.0]}


def room() -> dict[str, np.ndarray]:
    """A wall at 20 m all around, and a panel of 2 m 5 m ahead: the driver's columns of a sweep."""
    columns = scene(columns=900)
    rays = np.column_stack([columns[name] for name in "xyz"])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    at = 20.0 * rays
    panel = rays * (5.0 / np.maximum(rays[:, 0], 1e-9))[:, None]
    on = (rays[:, 0] > 0.1) & (np.abs(panel[:, 1]) < 1.0)
    at[on] = panel[on]
    return columns | dict(zip("xyz", at.T, strict=True))


def pixels_of(columns: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) of the points that lie in the image, by the pinhole's own formula, and their depths."""
    right, down, ahead = 0.5 - columns["y"], -columns["z"], columns["x"]
    before = ahead > 0.01
    right, down, ahead = right[before], down[before], ahead[before]
    u, v = 500.0 * right / ahead + 320.0, 501.0 * down / ahead + 240.0
    inside = (u > -0.5) & (v > -0.5) & (u < SIZE[0] - 0.5) & (v < SIZE[1] - 0.5)
    return np.column_stack([u, v])[inside], ahead[inside]


@pytest.fixture
def rig(api, fleet):
    return seed_rig(api.database, fleet)


@pytest.fixture
def recorded(context: Context, rig, tmp_path):
    """A ready recording with black frames."""
    frames = list(images(4, "/camera/compressed", png(*SIZE)))
    file = write_bag(tmp_path / "walk.bag", interleaved(clouds(4, room()), frames))
    recording = uploaded(context, rig, file)
    work(context)
    return recording.id


@pytest.fixture
def result(api, rig):
    """A result of imported pairs, whose camera stands aside."""
    _, (found, _) = seed_results(api, rig)
    with api.database.writing() as session:
        session.get_one(Result, found).document = DOCUMENT | {"transform": ASIDE}
    return found


@pytest.fixture
def reviewer(api, fleet):
    return api.member(fleet, "reviewer", "Rev")


def ask(actor, result, **body):
    return actor.post(f"/results/{result}/overlays", body)


def drawn(actor, context, result, **body):
    """An overlay that was made, and its image, BGR."""
    asked = ask(actor, result, **body)
    assert asked.status_code == 202, asked.text
    work(context)
    made = actor.get(f"/overlays/{asked.json()['id']}").json()
    assert made["state"] == "done", made
    answer = actor.get(f"/overlays/{made['id']}/image")
    assert answer.status_code == 200 and answer.headers["content-type"] == "image/png"
    return made, cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)


def track(api, recording):
    """A detection with the corner at the panel's middle, which goes 2 m/s to the left. Returns its id."""
    with api.database.writing() as session:
        fleet_id = session.get_one(Recording, recording).fleet_id
        detection = Detection(
            fleet_id=fleet_id, recording_id=recording, region={}, detector="refined", options={}, pairing={},
            content_hash="0", state="done",
        )  # fmt: skip
        session.add(detection)
        session.flush()
        for rank, seconds in enumerate((-0.05, 0.4)):
            place = {"x": 5.0, "y": 2.0 * seconds, "z": 0.5}
            apex = Apex(recording_id=recording, sweep_index=rank, **place)
            session.add(apex)
            session.flush()
            time_ns = START_NS + int(seconds * 1e9)
            session.add(
                Vertex(
                    detection_id=detection.id,
                    apex_id=apex.id,
                    rank=rank,
                    sweep_index=rank,
                    time_ns=time_ns,
                    ring=3,
                    points=2,
                    **place,
                )
            )
        return detection.id


def answer(api, recording, detection_id, person_id) -> None:
    """Somebody rejects the detection's first vertex, which is paired with the first frame."""
    with api.database.writing() as session:
        camera = session.scalars(select(Sensor.id).where(Sensor.name == "front")).one()
        vertex = session.scalars(select(Vertex).where(Vertex.detection_id == detection_id, Vertex.rank == 0)).one()
        session.add(VertexFrame(vertex_id=vertex.id, sensor_id=camera, frame_index=0, gap_ns=0))
        said = {"apex_id": vertex.apex_id, "person_id": person_id, "verdict": "rejected", "version": 1}
        session.add(Verdict(recording_id=recording, **said))


def taken(api, recording) -> tuple[int, int]:
    """What is counted of a recording, and what the store holds."""
    with api.database.reading() as session:
        stored = session.scalar(select(func.sum(Blob.size)).where(Blob.state == "stored"))
        return session.get_one(Recording, recording).taken_bytes, stored


def test_what_the_camera_sees_is_drawn_and_nothing_else(api, reviewer, recorded, result, context):
    made, image = drawn(reviewer, context, result, frame=1, recording_id=str(recorded))
    places, depths = pixels_of(room())
    told = made["result"]
    assert (told["width"], told["height"]) == SIZE == (image.shape[1], image.shape[0])
    # Points behind the camera or beside the image are in neither number.
    assert told["points"] + told["hidden"] == len(places) and told["hidden"] > 50
    assert told["moved"] == 0 and told["depth_m"][0] < 6.0 and told["depth_m"][1] > 19.0
    on_panel, wall = depths < 10.0, depths > 10.0
    colours = image[tuple(np.rint(places[:, ::-1]).astype(int).clip(0, np.array(SIZE[::-1]) - 1).T)].astype(int)
    near, far = (np.median(colours[some], axis=0) for some in (on_panel, wall))
    assert np.abs(near - far).max() > 60
    assert (np.abs(colours[on_panel] - near).max(1) < 60).mean() > 0.99
    # Of the wall's points those that the panel covers are hidden. It ends 0.5 m left and 1.5 m right of the camera.
    left, right = (500.0 * (0.5 - y) / 5.0 + 320.0 for y in (1.0, -1.0))
    within = (places[:, 0] > left + 15) & (places[:, 0] < right - 15)
    assert (wall & within).sum() > 30
    drawn_far = np.abs(colours[wall & within] - far).max(1) < 20
    assert drawn_far.sum() == 0
    assert (np.abs(colours[wall & ~within] - far).max(1) < 60).mean() > 0.8
    # All other pixels are the frame's.
    drawn_at = np.argwhere(image.any(2))[:, ::-1]
    assert max(np.abs(places - at).max(1).min() for at in drawn_at[:: max(1, len(drawn_at) // 500)]) < 2.5


def test_the_board_is_drawn_at_the_frames_time(api, reviewer, recorded, result, context):
    track(api, recorded)
    told = drawn(reviewer, context, result, frame=1, recording_id=str(recorded))[0]["result"]
    # The sweep before the frame has its middle nearest to it; its beginning is up to 0.1 s away.
    assert told["moved"] > 100 and 0.02 < told["farthest_moved_m"] < 2.0 * 0.12
    later = drawn(reviewer, context, result, frame=3, recording_id=str(recorded))[0]["result"]
    assert later["moved"] > 100 and later["sweep_index"] > told["sweep_index"]


def test_an_image_that_has_not_changed_is_not_sent_again(reviewer, recorded, result, context):
    asked = ask(reviewer, result, frame=0, recording_id=str(recorded)).json()
    address = f"/overlays/{asked['id']}/image"
    assert reviewer.get(address).json()["code"] == "overlay_not_ready"
    work(context)
    answer = reviewer.get(address)
    assert answer.headers["content-disposition"].endswith("front-frame-0.png")
    again = reviewer.get(address, headers={"If-None-Match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    (listed,) = reviewer.get(f"/recordings/{recorded}/overlays").json()["items"]
    assert listed["id"] == asked["id"] and listed["result"]["size"] == len(answer.content)


def test_reviewers_draw_and_look_others_do_not(api, fleet, reviewer, recorded, result, context):
    made = ask(reviewer, result, frame=0, recording_id=str(recorded)).json()
    work(context)
    for role in ("viewer", "annotator"):
        member = api.member(fleet, role, role)
        assert ask(member, result, frame=0, recording_id=str(recorded)).status_code == 403
        assert member.get(f"/overlays/{made['id']}").status_code == 200
        assert member.get(f"/overlays/{made['id']}/image").status_code == 403
        assert member.delete(f"/overlays/{made['id']}").status_code == 403
    outsider = api.member(api.fleet(), "admin", "Else")
    assert outsider.get(f"/overlays/{made['id']}/image").status_code == 404


def test_what_cannot_be_asked(api, fleet, rig, reviewer, recorded, result):
    other = another_rig(api, rig, "later")
    with api.database.writing() as session:
        of_other = Recording(
            fleet_id=fleet, vehicle_id=other.vehicle_id, rig_id=other.id, name="x", file_name="x", state="ready"
        )
        session.add(of_other)
        session.flush()
        elsewhere = str(of_other.id)
    here = str(recorded)
    for body, status, code in (
        ({"frame": 0}, 422, "no_recording"),
        ({"frame": 4, "recording_id": here}, 404, "no_such_frame"),
        ({"frame": 0, "recording_id": elsewhere}, 422, "recording_of_another_rig"),
    ):
        refused = ask(reviewer, result, **body)
        assert (refused.status_code, refused.json()["code"]) == (status, code), refused.text
    with api.database.writing() as session:
        sized = DOCUMENT["intrinsics"] | {"image_size": [1280, 960]}
        session.get_one(Result, result).document = DOCUMENT | {"intrinsics": sized}
    refused = ask(reviewer, result, frame=0, recording_id=here)
    assert (refused.status_code, refused.json()["code"]) == (422, "image_size_differs")


def test_deleted_overlays_leave_nothing_and_a_recording_takes_them_along(
    api, engineer, reviewer, recorded, result, context
):
    before, _ = taken(api, recorded)
    first, _ = drawn(reviewer, context, result, frame=0, recording_id=str(recorded))
    drawn(reviewer, context, result, frame=1, recording_id=str(recorded))
    assert taken(api, recorded)[0] == taken(api, recorded)[1] > before + first["result"]["size"]
    assert reviewer.delete(f"/overlays/{first['id']}").status_code == 204
    assert reviewer.get(f"/overlays/{first['id']}").status_code == 404
    assert taken(api, recorded)[0] == taken(api, recorded)[1] > before
    assert engineer.delete(f"/recordings/{recorded}").status_code == 204
    sweep(api.database, context.store)
    with api.database.reading() as session:
        assert session.scalars(select(Blob)).all() == [] and session.scalars(select(Study)).all() == []


def test_a_fleet_without_room_hears_why(api, reviewer, recorded, result, context):
    before, _ = taken(api, recorded)
    with api.database.writing() as session:
        session.get_one(Fleet, session.get_one(Recording, recorded).fleet_id).quota_bytes = before + 10
    asked = ask(reviewer, result, frame=0, recording_id=str(recorded)).json()["id"]
    work(context)
    row = reviewer.get(f"/overlays/{asked}").json()
    assert (row["state"], row["problem"]["code"]) == ("failed", "fleet_quota_exceeded")
    assert taken(api, recorded)[0] == before


def test_a_look_at_what_others_marked_is_a_disclosure(api, engineer, reviewer, recorded, result, context):
    """The recording of the pairs is the default, and their detection has the track and the clock's offset."""
    detection_id = track(api, recorded)
    answer(api, recorded, detection_id, engineer.person_id)
    with api.database.writing() as session:
        pairs = session.scalars(select(CorrespondenceSet)).one()
        pairs.recording_id, pairs.detection_id, pairs.source = recorded, detection_id, "annotations"
        session.get_one(Detection, detection_id).pairing = {"offset_ns": 100_000_000}
    asked = ask(reviewer, result, frame=2).json()
    work(context)
    with api.database.reading() as session:
        assert session.scalars(select(Disclosure)).all() == []
    assert reviewer.get(f"/overlays/{asked['id']}/image").status_code == 200
    with api.database.reading() as session:
        (told,) = session.scalars(select(Disclosure))
        assert (told.person_id, told.told_in) == (reviewer.person_id, "result")
    made = reviewer.get(f"/overlays/{asked['id']}").json()
    before = drawn(reviewer, context, result, frame=1)[0]
    assert made["recording_id"] == str(recorded) and made["result"]["moved"] > 100
    # By the LiDAR's clock the frame was taken 0.1 s before its stamp.
    assert abs(made["result"]["after_ns"]) <= 60_000_000
    assert made["result"]["sweep_index"] == before["result"]["sweep_index"] + 1 <= 1
