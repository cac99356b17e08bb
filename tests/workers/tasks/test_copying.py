"""A recording with its published calibration put in: asked for over HTTP, copied by a worker, read as a file."""

from __future__ import annotations

import hashlib
import zipfile

import numpy as np
import pytest
from sqlalchemy import func, select

from service.platform.db.models import Analysis, AnalysisFile, Blob
from service.platform.db.recordings import CameraFrame
from service.platform.db.recordings import Recording as Row
from service.platform.jobs.reaper import reap
from tests.service.detections.seeding import seed_rig
from tests.service.publications.given import publish
from tests.support.databases import one_database
from tests.support.work import work
from tests.workers.readers.making_packets import captured, packets, write_pcap
from tests.workers.readers.making_recordings import START_NS, clouds, images, interleaved, png, write_bag
from tests.workers.readers.making_recordings import TYPES as ROS1
from tests.workers.readers.making_transforms import LIDAR, TF, message
from tests.workers.readers.viewing.reading_viewer_files import chain, messages, rectified
from tests.workers.tasks.test_ingesting import uploaded
from workers.readers.detect import open_recording
from workers.tasks.context import Context

pytestmark = one_database
CAMERA = ("base_link", "mount", (1.5, 0.1, 1.4), (0.0, 0.0, 0.0, 1.0))
OPTICAL = ("mount", "camera", (0.0, 0.0, 0.0), (-0.5, 0.5, -0.5, 0.5))


@pytest.fixture
def recorded(api, fleet, context: Context, tmp_path):
    """A ready recording of a rig whose camera has a published calibration."""
    rig = seed_rig(api.database, fleet)
    said = [("/tf_static", TF, START_NS, message(ROS1, [LIDAR, CAMERA, OPTICAL]))]
    frames = list(images(4, "/camera/compressed", png(640, 480)))
    file = write_bag(tmp_path / "walk.bag", interleaved(said, clouds(4), frames))
    recording = uploaded(context, rig, file)
    work(context)
    publish(api, rig, api.member(fleet, "reviewer"))
    return recording.id


def ask(engineer, recording, **body):
    return engineer.post("/analyses", {"kind": "calibrated_copy", "recording_id": str(recording)} | body)


def taken(api, recording) -> tuple[int, int]:
    """What is counted of a recording, and what the store holds."""
    with api.database.reading() as session:
        stored = session.scalar(select(func.sum(Blob.size)).where(Blob.state == "stored"))
        return session.get_one(Row, recording).taken_bytes, stored


def test_the_copy_holds_the_published_calibration(api, engineer, recorded, context, tmp_path):
    asked = ask(engineer, recorded)
    assert asked.status_code == 202, asked.text
    (pose,) = asked.json()["poses"]
    assert (pose["parent"], pose["child"], pose["is_new"]) == ("base_link", "mount", False)
    address = f"/analyses/{asked.json()['id']}"
    assert engineer.get(f"{address}/file").json()["code"] == "no_file"
    work(context)
    made = engineer.get(address).json()
    assert made["state"] == "done", made
    assert made["result"]["file_name"] == "walk-calibrated.bag" and made["result"]["replaced"] == 1
    answer = engineer.get(f"{address}/file")
    assert answer.headers["content-disposition"].endswith("walk-calibrated.bag")
    assert hashlib.sha256(answer.content).hexdigest() == made["result"]["sha256"]
    file = tmp_path / "copy.bag"
    file.write_bytes(answer.content)
    recording = open_recording(file)
    try:
        (camera,) = [one for one in recording.sensors if one.kind == "camera"]
        poses = {one.child: one for one in recording.static_transforms}
    finally:
        recording.close()
    assert camera.camera_info["K"] == [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0]
    # LEVEL: the camera stands 0.2 m before and 0.1 m below the LiDAR, which stands at (1.2, 0, 1.9).
    assert poses["mount"].translation_m == pytest.approx((1.4, 0.0, 1.8))
    assert poses["mount"].quaternion_xyzw == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-12)
    assert poses["velodyne"].translation_m == [*LIDAR[2]] and poses["camera"].translation_m == [*OPTICAL[2]]
    assert taken(api, recorded)[0] == taken(api, recorded)[1]


def test_a_named_joint_and_what_cannot_be_asked(api, engineer, recorded):
    (pose,) = ask(engineer, recorded, joints={"front": "camera"}).json()["poses"]
    assert (pose["parent"], pose["child"]) == ("mount", "camera")
    for body, code in (
        ({"joints": {"front": "velodyne"}}, "frames_not_usable"),
        ({"joints": {"rear": "mount"}}, "camera_not_recorded"),
        ({"alias": "canary"}, "no_calibration_yet"),
    ):
        refused = ask(engineer, recorded, **body)
        assert refused.status_code in (404, 422) and refused.json()["code"] == code, refused.text


def test_a_deleted_copy_and_a_deleted_recording_leave_nothing(api, engineer, recorded, context):
    first, second = (ask(engineer, recorded).json()["id"] for _ in range(2))
    work(context)
    before, _ = taken(api, recorded)
    assert engineer.delete(f"/analyses/{first}").status_code == 204
    assert engineer.get(f"/analyses/{first}").status_code == 404
    with api.database.reading() as session:
        size = session.scalar(select(Blob.size).join(AnalysisFile, AnalysisFile.blob_key == Blob.key))
    assert taken(api, recorded) == (before - size, before - size)
    deleted = engineer.delete(f"/recordings/{recorded}")
    assert deleted.status_code == 204, deleted.text
    reap(api.database, context.store)
    with api.database.reading() as session:
        assert session.scalars(select(Blob)).all() == [] and session.scalars(select(Analysis)).all() == []
    assert second


def from_packets(tmp_path):
    """An archive of a packet capture and a folder of images: no bag."""
    root = tmp_path / "drive"
    (root / "front").mkdir(parents=True)
    write_pcap(root / "lidar.pcap", captured(packets(turns=4.3)))
    for i in range(4):
        stamp_ns = START_NS + i * 100_000_000 + 12_000_000
        (root / "front" / f"{stamp_ns}.png").write_bytes(png(640, 480, 60 * i))
    with zipfile.ZipFile(tmp_path / "drive.zip", "w") as archive:
        for file in sorted(root.rglob("*.p*")):
            archive.write(file, file.relative_to(tmp_path))
    return tmp_path / "drive.zip"


def test_any_recording_has_a_file_for_viewers(api, fleet, engineer, context, tmp_path):
    rig = seed_rig(api.database, fleet)
    recording = uploaded(context, rig, from_packets(tmp_path))
    work(context)
    publish(api, rig, api.member(fleet, "reviewer"))
    asked = ask(engineer, recording.id, for_viewers=True)
    assert asked.status_code == 202 and asked.json()["for_viewers"], asked.text
    work(context)
    made = engineer.get(f"/analyses/{asked.json()['id']}").json()
    assert made["state"] == "done", made
    assert made["result"]["file_name"] == "drive-for-viewers.mcap"
    sweeps = made["result"]["copied"] - 4
    assert sweeps >= 4 and made["result"]["left_out"] == 0 and made["result"]["added"] == 3 * 4 + sweeps
    file = tmp_path / "seen.mcap"
    file.write_bytes(engineer.get(f"/analyses/{made['id']}/file").content)
    with api.database.reading() as session:
        stamps = session.scalars(select(CameraFrame.stamp_ns).order_by(CameraFrame.index)).all()
    assert [at for _, at, _ in messages(file, "/front/raw/image")] == stamps
    assert len(messages(file, "/lidar")) == sweeps
    _, _, flat = messages(file, "/front/undistorted/calibration")[0]
    _, _, tree = messages(file, "/tf")[0]
    R, t = chain(tree.transforms, flat.frame_id, messages(file, "/lidar")[0][2].frame_id)
    # LEVEL: what is 10 m ahead of the LiDAR is 9.8 m ahead of the camera, and 0.1 m below its axis is 0.
    given = engineer.get(f"/vehicles/{rig.vehicle_id}/cameras/front/calibration").json()
    lens = given["intrinsics"]
    (seen,) = rectified(flat, np.array([[10.0, 1.0, 0.5]]) @ R.T + t)
    x, y, z = -1.0, -0.5 - 0.1, 10.0 - 0.2
    assert seen == pytest.approx([lens["f_x"] * x / z + lens["c_x"], lens["f_y"] * y / z + lens["c_y"]], abs=1e-4)
    refused = ask(engineer, recording.id, for_viewers=True, joints={"front": "mount"})
    assert refused.status_code == 422 and "joints" in refused.text
    assert taken(api, recording.id)[0] == taken(api, recording.id)[1]
