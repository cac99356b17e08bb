"""A recording that cannot be used is answered with what is wrong and what to do; only its original is kept."""

import io
import tarfile

import pytest
from sqlalchemy import func, select

from service.platform.db.models import Blob, CameraFrame, Sensor, UploadPart
from tests.support.uploads import RIG, new_recording, upload
from tests.support.work import work
from tests.workers.readers.making_recordings import (
    PERIOD_NS,
    START_NS,
    clouds,
    images,
    interleaved,
    png,
    write_bag,
)


def bag(tmp_path, *streams):
    return write_bag(tmp_path / "made.bag", interleaved(*streams)).read_bytes()


def good(tmp_path):
    return bag(tmp_path, clouds(), images(data=png(1280, 720)))


@pytest.fixture
def bring(context, engineer, fleet):
    """Upload such bytes, in these parts, and read them; the recording as it was made, and the answer for it then."""

    def brought(*parts, reading=None, **sent):
        made = new_recording(engineer, fleet, **({} if reading is None else {"reading": reading}))
        assert upload(engineer, made["id"], list(parts), **sent).status_code == 202
        work(context)
        return made, engineer.get(f"/recordings/{made['id']}")

    return brought


def linking_tar(tmp_path):
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        entry = tarfile.TarInfo("images/1.png")
        entry.type, entry.linkname = tarfile.SYMTYPE, "/etc/passwd"
        archive.addfile(entry)
    return buffer.getvalue()


# One for each place where it is noticed: file, topics, rig, archive. Every kind is among the tests of readers.
BAD = {
    "truncated": (lambda tmp: good(tmp)[:-2000], "recording_truncated"),
    "without LiDAR": (lambda tmp: bag(tmp, images()), "no_lidar_topic"),
    "another size than the rig's": (lambda tmp: bag(tmp, clouds(), images()), "image_size_differs"),
    "tar with a link": (linking_tar, "folder_refused"),
}


@pytest.mark.parametrize("kind", BAD)
def test_it_fails_with_its_reason_and_keeps_the_original(context, engineer, bring, tmp_path, kind):
    make, code = BAD[kind]
    data = make(tmp_path)
    made, answer = bring(data[: len(data) // 2], data[len(data) // 2 :])
    failed = answer.json()
    assert failed["state"] == "failed"
    problem = failed["problem"]
    assert problem["code"] == code
    assert problem["detail"] and problem["hint"]
    assert "Traceback" not in str(problem) and str(context.settings.data_dir) not in str(problem)
    assert failed["sensors"] == []
    with context.database.reading() as session:
        assert session.scalar(select(func.count()).select_from(Sensor)) == 0
        assert session.scalar(select(func.count()).select_from(CameraFrame)) == 0
        kept = set(session.scalars(select(Blob.key).where(Blob.state == "stored")))
        assert kept == set(session.scalars(select(UploadPart.blob_key)))
    assert engineer.get(f"/recordings/{made['id']}/original").content == data


def test_which_is_which_is_asked_with_what_there_is(context, engineer, bring, tmp_path):
    data = bag(tmp_path, clouds(), images(data=png(1280, 720)), images(topic="/b/compressed", data=png(1280, 720)))
    made, failed = bring(data)
    problem = failed.json()["problem"]
    assert problem["code"] == "ambiguous_cameras" and problem["cameras"] == ["front"]
    assert {one["name"] for one in problem["candidates"]} == {"/b/compressed", "/camera/compressed"}
    edit = {"If-Match": failed.headers["ETag"]}
    reading = {"topics": {"cameras": {"front": "/b/compressed"}}}
    assert engineer.patch(f"/recordings/{made['id']}", {"reading": reading}, headers=edit).status_code == 200
    assert engineer.post(f"/recordings/{made['id']}/retry").status_code == 202
    work(context)
    ready = engineer.get(f"/recordings/{made['id']}").json()
    assert (ready["state"], ready["sensors"][0]["topic"]) == ("ready", "/b/compressed")
    assert ready["sensors"][0]["facts"]["overlap_share"] > 0.9 and ready["facts"]["together_s"] > 0.3


def test_a_whole_whose_checksum_is_wrong_fails_before_it_is_read(bring, tmp_path):
    failed = bring(good(tmp_path), sha256="0" * 64)[1].json()
    assert (failed["state"], failed["problem"]["code"]) == ("failed", "checksum_mismatch")


@pytest.mark.parametrize(("reading", "source"), [({}, "per_point"), ({"point_times": "stamp_only"}, "stamp_only")])
def test_what_the_owner_knows_of_the_file_reaches_the_reader(bring, tmp_path, reading, source):
    made, ready = bring(good(tmp_path), reading=reading)
    assert made["reading"] == reading
    lidar = ready.json()["sensors"][1]
    assert lidar["facts"]["time_source"] == source


def test_a_good_one_is_ready_and_its_frames_are_served_as_they_were(engineer, bring, tmp_path):
    made, answer = bring(good(tmp_path))
    ready = answer.json()
    assert (ready["state"], ready["problem"]) == ("ready", None)
    assert [sensor["name"] for sensor in ready["sensors"]] == ["front", "lidar"]
    between = {"from_ns": START_NS + PERIOD_NS, "to_ns": START_NS + 2 * PERIOD_NS + 12_000_000}
    items = engineer.get(f"/recordings/{made['id']}/cameras/front/frames", params=between).json()["items"]
    assert [item["index"] for item in items] == [1, 2]
    frame = engineer.get(f"/recordings/{made['id']}/cameras/front/frames/2")
    assert frame.content[:8] == b"\x89PNG\r\n\x1a\n"
    assert frame.headers["Content-Type"] == "image/png"


def test_a_recording_with_the_wrong_rig_is_read_again_with_the_right_one(context, engineer, bring, tmp_path):
    made, failed = bring(bag(tmp_path, clouds(), images(data=png(640, 480))))
    assert failed.json()["problem"]["code"] == "image_size_differs"
    assert "640 x 480" in failed.json()["problem"]["detail"]
    right = RIG | {"name": "small", "cameras": [RIG["cameras"][0] | {"image_size": [640, 480]}]}
    rig = engineer.post(f"/vehicles/{made['vehicle_id']}/rigs", right).json()
    edit = {"If-Match": failed.headers["ETag"]}
    assert engineer.patch(f"/recordings/{made['id']}", {"rig_id": rig["id"]}, headers=edit).status_code == 200
    assert engineer.post(f"/recordings/{made['id']}/retry").status_code == 202
    work(context)
    ready = engineer.get(f"/recordings/{made['id']}")
    assert (ready.json()["state"], ready.json()["rig_id"]) == ("ready", rig["id"])
    edit = {"If-Match": ready.headers["ETag"]}
    other = engineer.post(f"/vehicles/{made['vehicle_id']}/rigs", RIG | {"name": "third"}).json()
    refused = engineer.patch(f"/recordings/{made['id']}", {"rig_id": other["id"]}, headers=edit)
    assert (refused.status_code, refused.json()["code"]) == (409, "sensors_differ")
