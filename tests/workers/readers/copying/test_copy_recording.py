"""A recording with its calibration put in: rosbags reads it, and every other message is the same, byte for byte."""

from __future__ import annotations

import dataclasses
import sqlite3
import tarfile
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import yaml
from making_recordings import COMPRESSED, START_NS, clouds, images, interleaved, write_bag
from making_recordings import TYPES as ROS1
from making_ros2 import INFO, as_cdr, rig, write_mcap, write_ros2
from making_ros2 import TYPES as ROS2
from making_transforms import CAMERA, LIDAR, TF, message
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.rosbag2.metadata import parse_qos

from workers.readers.copying.copy_recording import copy_recording
from workers.readers.copying.editor import LATCHED_QOS
from workers.readers.detect import open_recording
from workers.readers.normalised.normalise import normalise
from workers.readers.recording import ReadError

POSE = {
    "parent": "base_link",
    "child": "camera",
    "translation_m": [1.1, 0.2, 1.6],
    "quaternion_xyzw": [-0.6, 0.4, -0.4, 0.56],
    "is_new": False,
}
LENS = {
    "name": "front",
    "topic": "/front/image_raw/compressed",
    "frame_id": "camera",
    "width": 8,
    "height": 6,
    "distortion_model": "equidistant",
    "K": [5.0, 0.0, 4.0, 0.0, 5.1, 3.0, 0.0, 0.0, 1.0],
    "D": [0.1, 0.02, 0.003, 0.0004],
}
ROS1_TOPIC = "/camera/compressed"
FORMS = ["rosbag1", "rosbag1 bz2", "db3", "mcap", "mcap lz4", "mcap plain", "mcap unchunked", "mcap cut",
         "folder db3", "folder mcap", "folder db3 message", "folder db3 file"]  # fmt: skip


def request(topic=LENS["topic"], **changed):
    return {"lidar_frame": "velodyne", "cameras": [LENS | {"topic": topic}], "poses": [POSE | changed]}


def write(tmp_path: Path, form: str, *, infos: bool = True, stated=(LIDAR, CAMERA), moving=()) -> tuple[Path, str]:
    """A recording in this form, and its camera's topic."""
    kind, *how = form.split()
    types = ROS1 if kind == "rosbag1" else ROS2
    said = [("/tf_static", TF, START_NS + 3 * n, message(types, [one])) for n, one in enumerate(stated)]
    said += [("/tf", TF, START_NS + 50_000_000, message(types, [one])) for one in moving]
    if kind == "rosbag1":
        from rosbags.rosbag1 import Writer

        compression = Writer.CompressionFormat.BZ2 if how else None
        path = write_bag(tmp_path / "walk.bag", interleaved(clouds(), images(), said), compression)
        return path, ROS1_TOPIC
    messages = interleaved(rig() if infos else (one for one in rig() if one[1] != INFO), said)
    if kind == "mcap":
        packed = {"lz4": CompressionType.LZ4, "plain": CompressionType.NONE}.get("".join(how), CompressionType.ZSTD)
        path = write_mcap(
            tmp_path / "walk.mcap", as_cdr(messages), compression=packed, chunked=how != ["unchunked"],
            summary=how != ["cut"],
        )  # fmt: skip
        if how == ["cut"]:
            path.write_bytes(path.read_bytes()[:-200])
        return path, LENS["topic"]
    if kind == "db3":
        folder = write_ros2(tmp_path / "walk", messages)
        return next(folder.glob("*.db3")), LENS["topic"]
    storage = "mcap" if how[0] == "mcap" else "sqlite3"
    folder = write_ros2(tmp_path / "walk", messages, storage, how[1].upper() if len(how) > 1 else None)
    packed = tmp_path / "walk.tar"
    with tarfile.open(packed, "w") as tar:
        tar.add(folder, arcname="walk")
    return packed, LENS["topic"]


def read_all(path: Path, tmp_path: Path, name: str) -> list[tuple[str, int, bytes]]:
    """Every message as rosbags gives it, of a bare MCAP file as mcap does: these state no profile."""
    if path.suffix == ".mcap":
        with path.open("rb") as file:
            every = sorted(read_mcap(file), key=lambda one: one[2].log_time)
            return [(channel.topic, message.log_time, message.data) for _, channel, message in every]
    if path.suffix == ".tar":
        folder = tmp_path / name
        with tarfile.open(path) as tar:
            tar.extractall(folder, filter="data")
        path = next(folder.iterdir())
    with AnyReader([path]) as reader:
        return [(connection.topic, time, bytes(raw)) for connection, time, raw in reader.messages()]


def read_mcap(file):
    """Up to the end of the file, or to where it is cut off."""
    try:
        yield from NonSeekingReader(file).iter_messages(log_time_order=False)
    except EndOfFile:
        return


def copied(tmp_path: Path, path: Path, asked) -> Path:
    made = copy_recording(path, tmp_path / "out", asked, lambda share: None)
    return tmp_path / "out" / made["file"]


@pytest.mark.parametrize("form", FORMS)
def test_intrinsics_and_frames_are_put_in_and_all_other_messages_are_the_same(tmp_path, form):
    path, topic = write(tmp_path, form)
    made = copy_recording(path, tmp_path / "out", request(topic), lambda share: None)
    file = tmp_path / "out" / made["file"]
    before, after = (read_all(one, tmp_path, name) for one, name in ((path, "before"), (file, "after")))
    has_infos = not form.startswith("rosbag1")
    edited = {"/tf_static", "/front/camera_info"} if has_infos else {"/tf_static", "/camera_info"}
    kept_before, kept_after = ([one for one in listed if one[0] not in edited] for listed in (before, after))
    assert kept_before == kept_after and len(kept_before) > 5
    assert [one[:2] for one in before if one[0] == "/tf_static"] == [
        one[:2] for one in after if one[0] == "/tf_static"
    ]
    infos = sum(one[0] == "/front/camera_info" for one in before)
    assert made["replaced"] == 1 + infos and made["added"] == (0 if has_infos else 5)
    assert made["copied"] + made["replaced"] == len(before) and len(after) == len(before) + made["added"]
    with closing(open_recording(file)) as recording:
        (camera,) = [sensor for sensor in recording.sensors if sensor.kind == "camera"]
        assert camera.camera_info["K"] == LENS["K"] and camera.camera_info["D"] == LENS["D"]
        assert camera.camera_info["model"] == "kannala_brandt"
        poses = {(one.parent, one.child): tuple(one.translation_m) for one in recording.static_transforms}
    assert poses == {LIDAR[:2]: LIDAR[2], ("base_link", "camera"): tuple(POSE["translation_m"])}
    normalise(file, tmp_path / "again")  # it can be read like any recording


@pytest.mark.parametrize("form", ["rosbag1", "db3", "mcap", "mcap cut", "folder db3", "folder mcap"])
def test_what_the_recording_lacks_is_added(tmp_path, form):
    path, topic = write(tmp_path, form, infos=False, stated=())
    file = copied(tmp_path, path, request(topic, parent="velodyne", is_new=True))
    info = "/camera_info" if form == "rosbag1" else "/front/camera_info"
    before, after = (read_all(one, tmp_path, name) for one, name in ((path, "before"), (file, "after")))
    added = [one for one in after if one not in before]
    frames = [time for name, time, _ in before if name == topic]
    assert sorted(one[0] for one in added) == [*[info] * len(frames), "/tf_static"] and len(frames) > 2
    assert [time for name, time, _ in added if name == info] == frames
    assert min(time for _, time, _ in after) == next(time for name, time, _ in added if name == "/tf_static")
    with closing(open_recording(file)) as recording:
        (camera,) = [sensor for sensor in recording.sensors if sensor.kind == "camera"]
        assert camera.camera_info["K"] == LENS["K"]
        (pose,) = recording.static_transforms
        assert (pose.parent, pose.child) == ("velodyne", "camera")


def test_added_intrinsics_have_the_stamps_and_frames_of_their_images(tmp_path):
    path, topic = write(tmp_path, "mcap", infos=False)
    file = copied(tmp_path, path, request(topic))
    for name, _, raw in read_all(file, tmp_path, "after"):
        if name == "/front/camera_info":
            info = ROS2.deserialize_cdr(raw, INFO)
            assert info.header.frame_id == "camera" and np.array_equal(
                info.p.reshape(3, 4)[:, :3].reshape(-1), info.k
            )
    stamps = [ROS2.deserialize_cdr(raw, COMPRESSED).header.stamp.nanosec for name, _, raw in
              read_all(file, tmp_path, "x") if name == topic]  # fmt: skip
    infos = [ROS2.deserialize_cdr(raw, INFO).header.stamp.nanosec for name, _, raw in
             read_all(file, tmp_path, "y") if name == "/front/camera_info"]  # fmt: skip
    assert infos == stamps


def refusal(tmp_path, path, asked) -> ReadError:
    with pytest.raises(ReadError) as refused:
        copied(tmp_path, path, asked)
    return refused.value


def test_of_rectified_images_p_alone_is_put_in(tmp_path):
    """K and D are the raw images' still, R turns as before, and a stereo camera keeps its baseline."""
    P = np.array([4.0, 0.0, 3.5, -0.48, 0.0, 4.0, 2.5, 0.0, 0.0, 0.0, 1.0, 0.0])
    R = np.array([0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])

    def written(one):
        topic, kind, log_ns, info = one
        return (topic, kind, log_ns, dataclasses.replace(info, p=P, r=R)) if kind == INFO else one

    path = write_mcap(tmp_path / "walk.mcap", as_cdr(written(one) for one in rig()))
    lens = LENS | {"is_rectified": True, "D": [0.0] * 5, "distortion_model": "plumb_bob"}
    file = copied(tmp_path, path, {"lidar_frame": "velodyne", "cameras": [lens], "poses": []})
    before, after = (
        [
            ROS2.deserialize_cdr(raw, INFO)
            for name, _, raw in read_all(one, tmp_path, "x")
            if name == "/front/camera_info"
        ]
        for one in (path, file)
    )
    assert len(after) == 5
    for old, new in zip(before, after, strict=True):
        assert [list(getattr(new, name)) for name in "dkr"] == [list(getattr(old, name)) for name in "dkr"]
        assert new.distortion_model == old.distortion_model
        assert list(new.p) == pytest.approx([5.0, 0.0, 4.0, -0.6, 0.0, 5.1, 3.0, 0.0, 0.0, 0.0, 1.0, 0.0])


def test_a_frame_that_moves_is_refused(tmp_path):
    path, topic = write(tmp_path, "mcap", stated=(LIDAR,), moving=(CAMERA,))
    assert refusal(tmp_path, path, request(topic, is_new=True)).code == "frame_moves"


def test_a_pose_that_nobody_states_and_a_topic_that_is_not_there_are_refused(tmp_path):
    path, topic = write(tmp_path, "db3")
    assert refusal(tmp_path, path, request(topic, child="mast")).code == "copy_not_possible"
    assert "has no ROS messages" in refusal(tmp_path, path, request("/rear")).message


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_split_bag_gets_the_pose_although_its_first_file_has_no_camera(tmp_path, storage):
    """As a recorder leaves it that was started before its sensors. The first .db3 file holds no message at all."""
    folder = write_ros2(tmp_path / "walk", [one for one in rig() if one[1] != INFO], storage)
    empty = write_ros2(tmp_path / "empty", [], storage)
    (first,) = (file for file in empty.iterdir() if file.suffix in (".db3", ".mcap"))
    if storage == "mcap":
        with first.open("wb") as made:
            writer = Writer(made)
            writer.start()
            log = writer.register_channel("/rosout", "cdr", writer.register_schema("Log", "ros2msg", b""))
            writer.add_message(log, START_NS, b"", START_NS)
            writer.finish()
    first.rename(folder / f"a{first.suffix}")
    metadata = folder / "metadata.yaml"
    said = yaml.safe_load(metadata.read_text())
    said["rosbag2_bagfile_information"]["relative_file_paths"].insert(0, f"a{first.suffix}")
    metadata.write_text(yaml.safe_dump(said))
    with tarfile.open(tmp_path / "walk.tar", "w") as tar:
        tar.add(folder, arcname="walk")
    file = copied(tmp_path, tmp_path / "walk.tar", request(parent="velodyne", is_new=True))
    with closing(open_recording(file)) as recording:
        (pose,) = recording.static_transforms
        assert (pose.parent, pose.child) == ("velodyne", "camera")
        (camera,) = [sensor for sensor in recording.sensors if sensor.kind == "camera"]
        assert camera.camera_info["K"] == LENS["K"]
    with tarfile.open(file) as tar:
        text = tar.extractfile("bag/metadata.yaml").read()
    listed = yaml.safe_load(text)["rosbag2_bagfile_information"]["topics_with_message_count"]
    counts = {one["topic_metadata"]["name"]: one["message_count"] for one in listed}
    assert counts["/tf_static"] == 1 and 0 not in counts.values()


def test_a_schema_that_would_run_is_not_taken_over(tmp_path):
    path, topic = write(tmp_path, "db3")
    with sqlite3.connect(path) as db:
        db.execute("CREATE INDEX bomb ON messages (zeroblob(1000000))")
    db.close()
    file = copied(tmp_path, path, request(topic))
    with sqlite3.connect(file) as db:
        assert [name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'index'")] == [
            "timestamp_idx"
        ]
    db.close()
    with sqlite3.connect(path) as db:
        db.execute("CREATE TRIGGER late AFTER INSERT ON messages BEGIN DELETE FROM messages; END")
    db.close()
    assert refusal(tmp_path, path, request(topic)).code == "sqlite_not_plain"


def test_an_mcap_file_keeps_its_numbers_and_its_index_finds_every_message(tmp_path):
    path, topic = write(tmp_path, "mcap", infos=False)
    file = copied(tmp_path, path, request(topic))
    with path.open("rb") as one, file.open("rb") as other:
        plain = [(c.topic, m.log_time, m.publish_time, m.sequence) for _, c, m in make_reader(one).iter_messages()]
        reader = make_reader(other)
        found = list(reader.iter_messages())
        kept = [
            (c.topic, m.log_time, m.publish_time, m.sequence) for _, c, m in found if c.topic != "/front/camera_info"
        ]
        summary = reader.get_summary()
    assert kept == plain
    assert summary.statistics.message_count == len(found) == len(plain) + 5
    schema, channel, _ = next(one for one in found if one[1].topic == "/front/camera_info")
    assert schema.name == INFO and schema.encoding == "ros2msg" and b"float64[9] k" in schema.data
    assert "durability: 2" in channel.metadata["offered_qos_profiles"]


def test_an_mcap_file_keeps_attachments_metadata_and_channels_that_are_not_ros(tmp_path):
    path, topic = write(tmp_path, "mcap")
    whole = path.read_bytes()
    with path.open("wb") as file, path.with_suffix(".plain").open("w+b") as plain:
        plain.write(whole)
        plain.seek(0)
        writer = Writer(file)
        writer.start(profile="ros2")
        notes = writer.register_channel(
            "/notes", "json", writer.register_schema("Note", "jsonschema", b"{}"), {"a": "b"}
        )
        writer.add_attachment(1, 2, "rig.yaml", "text/yaml", b"rig: roof")
        writer.add_metadata("drive", {"weather": "rain"})
        channels = {}
        for schema, channel, message in make_reader(plain).iter_messages(log_time_order=False):
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            times = (message.log_time, message.data, message.publish_time)
            writer.add_message(channels[channel.id], *times)
        writer.add_message(notes, START_NS, b'{"said": 1}', START_NS)
        writer.finish()
    file = copied(tmp_path, path, request(topic))
    with file.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        assert [(one.name, one.data) for one in reader.iter_attachments()] == [("rig.yaml", b"rig: roof")]
        assert [(one.name, one.metadata) for one in reader.iter_metadata()] == [("drive", {"weather": "rain"})]
        ((schema, channel, message),) = reader.iter_messages(topics=["/notes"])
        assert (schema.name, channel.metadata, message.data) == ("Note", {"a": "b"}, b'{"said": 1}')


def test_topics_of_a_bag_keep_their_quality_of_service_and_type(tmp_path):
    path, topic = write(tmp_path, "db3")
    query = "SELECT offered_qos_profiles, type_description_hash FROM topics WHERE name = '/tf_static'"
    with closing(sqlite3.connect(path)) as db:
        db.execute("UPDATE topics SET offered_qos_profiles = ? WHERE name = '/tf_static'", (LATCHED_QOS,))
        db.commit()
        ((_, stated),) = db.execute(query)
    with closing(sqlite3.connect(copied(tmp_path, path, request(topic)))) as db:
        ((qos, type_hash),) = db.execute(query)
    assert parse_qos(qos) == parse_qos(LATCHED_QOS) and type_hash == stated
    assert parse_qos(qos)[0].durability is QosDurability.TRANSIENT_LOCAL
