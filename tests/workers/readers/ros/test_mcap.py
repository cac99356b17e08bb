"""MCAP files: ROS messages and Foxglove's own, however they were written."""

import struct
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from making_recordings import PERIOD_NS, START_NS, clouds, images, interleaved, png, scene
from making_recordings import TYPES as ROS1
from making_ros2 import as_cdr, field, foxglove, rig, write_mcap
from mcap.writer import CompressionType
from reading_ros2 import check_damage, check_rig, failure, read
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from workers.readers.recording import Frame, Sweep


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("summary", [True, False])
def test_mcap_however_it_was_written(tmp_path, compression, chunked, summary):
    path = write_mcap(tmp_path / "a.mcap", as_cdr(rig()), compression=compression, chunked=chunked, summary=summary)
    recording, items, _ = read(path)
    check_rig(items)
    assert {s.count for s in recording.sensors} == {5} and recording.share_read > 0.5


def test_a_recording_that_was_interrupted_is_read_as_far_as_it_goes(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", as_cdr(rig(20)))
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * 0.5)])
    recording, items, warnings = read(path)
    assert 10 <= len(items) < 40 and recording.sensors[0].count < 20
    assert "ends without its index" in warnings[0]


def test_ros_1_messages_in_mcap(tmp_path):
    messages = [
        (topic, kind.replace("/msg/", "/"), "ros1", log_ns, bytes(ROS1.serialize_ros1(message, kind)))
        for topic, kind, log_ns, message in interleaved(clouds(), images())
    ]
    _, items, _ = read(write_mcap(tmp_path / "a.mcap", messages))
    check_rig(items)


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_foxgloves_own_messages(tmp_path, encoding):
    recording, items, warnings = read(write_mcap(tmp_path / "a.mcap", foxglove(encoding=encoding)))
    assert {(s.kind, s.name, s.frame_id) for s in recording.sensors} == {
        ("lidar", "/lidar", "velodyne"),
        ("camera", "/front/image", "camera"),
        ("camera", "/left/image", "left"),
    }
    sweeps = [item for item in items if isinstance(item, Sweep)]
    assert len(sweeps) == 3 and warnings == []
    np.testing.assert_allclose(sweeps[1].xyz[:, 0], scene()["x"], rtol=1e-6)
    np.testing.assert_array_equal(sweeps[1].intensity, scene()["intensity"])
    np.testing.assert_allclose(sweeps[1].offset_ns, scene()["time"] * 1e9, atol=1)
    frames = [item for item in items if isinstance(item, Frame)]
    assert frames[0].data == png(8, 6, 0) and frames[1].transcoded
    infos = {s.name: s.camera_info for s in recording.sensors}
    assert infos["/left/image"] is None
    assert (infos["/front/image"]["model"], infos["/front/image"]["D"]) == ("kannala_brandt", [0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize("newer", [True, False])
def test_foxgloves_messages_in_ros_2_by_the_files_own_definition(tmp_path, newer):
    kind, more = "foxglove_msgs/msg/PointCloud", "string uuid\n" if newer else ""
    text = f"\n{'=' * 80}\n".join(
        (
            "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\nuint32 point_stride\n"
            f"foxglove_msgs/PackedElementField[] fields\nuint8[] data\n{more}",
            f"MSG: foxglove_msgs/PackedElementField\nstring name\nuint32 offset\nuint8 type\n{more}",
        )
    )
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg(text, kind))
    made = types.types
    columns = scene()
    points = np.stack([columns[name].astype("<f4") for name in ("x", "y", "z", "ring")], 1)
    uuid = ("an id",) if newer else ()
    fields = [
        made["foxglove_msgs/msg/PackedElementField"](name, 4 * i, 7, *uuid)
        for i, name in enumerate(("x", "y", "z", "ring"))
    ]
    pose = made["geometry_msgs/msg/Pose"](
        made["geometry_msgs/msg/Point"](0, 0, 0), made["geometry_msgs/msg/Quaternion"](0, 0, 0, 1)
    )
    time = made["builtin_interfaces/msg/Time"](*divmod(START_NS, 10**9))
    cloud = made[kind](time, "lidar", pose, 16, fields, points.view(np.uint8).reshape(-1), *uuid)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/lidar", kind, typestore=types)
        writer.write(connection, START_NS, types.serialize_cdr(cloud, kind))
    recording, (sweep,), _ = read(tmp_path / "bag")
    assert recording.sensors[0].notes["fields"] == "x y z ring" and sweep.stamp_ns == START_NS
    np.testing.assert_array_equal(sweep.xyz, points[:, :3])


def test_encodings_and_types_that_are_not_read_are_named(tmp_path):
    messages = [
        ("/lidar", "foxglove.PointCloud", "flatbuffer", START_NS, b"x"),
        ("/imu", "sensor_msgs/msg/Imu", "cdr", START_NS, b"x"),
    ]
    recording, items, _ = read(write_mcap(tmp_path / "a.mcap", messages))
    assert not recording.sensors and not items
    said = " ".join(recording.other_topics)
    assert "encoded as flatbuffer, which is not read" in said and "/imu (sensor_msgs/msg/Imu)" in said


def video(count=6, first=0, codec="h264"):
    """(topic, schema, encoding, time, bytes) of a video, one frame a message, grey from dark to light."""
    context = av.CodecContext.create("libx264", "w")
    context.width, context.height, context.pix_fmt, context.time_base = 64, 48, "yuv420p", Fraction(1, 10)
    context.options = {"preset": "ultrafast", "tune": "zerolatency", "crf": "10"}
    made = []
    for i in range(count):
        frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 20 + 30 * i, np.uint8), format="bgr24")
        frame.pts = i
        made += context.encode(frame)
    made += context.encode(None)
    for i, packet in enumerate(made[first:], first):
        stamp = START_NS + i * PERIOD_NS
        time = field(1, field(1, ("v", stamp // 10**9)) + field(2, ("v", stamp % 10**9)))
        body = time + field(2, "camera") + field(3, bytes(packet)) + field(4, codec)
        yield "/video", "foxglove.CompressedVideo", "protobuf", stamp, body


def test_video_in_messages(tmp_path):
    recording, frames, warnings = read(write_mcap(tmp_path / "a.mcap", video()))
    assert [(s.kind, s.name, s.frame_id, s.count) for s in recording.sensors] == [("camera", "/video", "camera", 6)]
    assert [f.stamp_ns for f in frames] == [START_NS + i * PERIOD_NS for i in range(6)] and warnings == []
    assert {(f.media_type, f.width, f.height, f.transcoded) for f in frames} == {("image/jpeg", 64, 48, True)}
    means = [cv2.imdecode(np.frombuffer(f.data, np.uint8), cv2.IMREAD_COLOR).mean() for f in frames]
    np.testing.assert_allclose(means, 20 + 30 * np.arange(6), atol=5)


def test_video_that_begins_without_a_key_frame(tmp_path):
    _, frames, warnings = read(write_mcap(tmp_path / "a.mcap", video(first=2)))
    assert not frames and "4 of 4 frames of video could not be decoded" in warnings[0]


def test_video_in_another_codec(tmp_path):
    error = failure(write_mcap(tmp_path / "a.mcap", video(codec="theora")))
    assert error.code == "video_unsupported" and "theora" in error.message


def test_a_chunk_that_expands_beyond_what_it_says(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", as_cdr(rig(1)), chunk_size=1 << 20)
    data = bytearray(path.read_bytes())
    at = data.index(b"zstd") - 4 - 4 - 8
    struct.pack_into("<Q", data, at, 1000)
    path.write_bytes(data)
    error = failure(path)
    assert error.code == "recording_damaged" and "more than 1000 bytes" in error.message
    struct.pack_into("<Q", data, at, 1 << 40)
    path.write_bytes(data)
    assert "at most" in failure(path).message


def test_a_time_that_does_not_fit_a_number_with_a_sign_is_refused(tmp_path):
    messages = [(*most, 2**63 + stamp, data) for *most, stamp, data in as_cdr(rig(2))]
    error = failure(write_mcap(tmp_path / "a.mcap", messages))
    assert error.code == "recording_damaged" and "past the year 2262" in error.message


def summary_of(data):
    """Where the summary begins and where the footer does."""
    footer = len(data) - 8 - 20 - 9
    return struct.unpack_from("<Q", data, footer + 9)[0], footer


def test_a_damaged_index_is_answered_by_reading_through(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", as_cdr(rig(20)), chunk_size=4000)
    whole = path.read_bytes()
    _, everything, _ = read(path)
    start, _ = summary_of(whole)
    rng, warned = np.random.default_rng(0), 0
    for place in rng.integers(start, len(whole) - 16, 60):
        path.write_bytes(whole[:place] + rng.bytes(16) + whole[place + 16 :])
        _, items, warnings = read(path)
        warned += any("The index of a.mcap is damaged" in said for said in warnings)
        assert len(items) == len(everything)
        for item, known in zip(items, everything, strict=True):
            assert item.stamp_ns == known.stamp_ns
            assert item.data == known.data if isinstance(item, Frame) else (item.xyz == known.xyz).all()
    assert warned > 40  # of the others the footer itself is damaged, which says where the index is


@pytest.mark.parametrize("change", [1, -1, 1 << 40, (1 << 63) - 1])
def test_an_index_without_a_checksum_that_names_no_chunk(tmp_path, change):
    path = write_mcap(tmp_path / "a.mcap", as_cdr(rig(20)), chunk_size=4000)
    data = bytearray(path.read_bytes())
    start, footer = summary_of(data)
    at = data.index(b"\x08", start)
    while data[at] != 8 or not 30 < struct.unpack_from("<Q", data, at + 1)[0] < 500:  # the first chunk's index
        at += 1
    (chunk,) = struct.unpack_from("<Q", data, at + 9 + 16)
    struct.pack_into("<Q", data, at + 9 + 16, (chunk + change) % (1 << 64))
    struct.pack_into("<I", data, footer + 9 + 16, 0)
    path.write_bytes(data)
    _, items, warnings = read(path)
    check_rig(items, 20)
    assert any("The index of a.mcap is damaged" in said for said in warnings)


@pytest.mark.parametrize("rest", [b"", bytes(100), b"\1" + bytes(7)])
def test_an_mcap_file_with_nothing_in_it(tmp_path, rest):
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + rest)
    assert failure(tmp_path / "a.mcap").code == "recording_empty"


@pytest.mark.parametrize("kind", ["ros", "json"])
def test_damage_anywhere_is_a_clear_answer(tmp_path, kind):
    messages = as_cdr(rig(3)) if kind == "ros" else [*foxglove(), *foxglove(encoding="json")]
    check_damage(write_mcap(tmp_path / "a.mcap", messages, compression=CompressionType.NONE))
