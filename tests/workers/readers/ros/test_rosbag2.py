import struct
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from making_packets import packets
from making_recordings import CLOUD, COMPRESSED, DATA, PERIOD_NS, START_NS, clouds, images, interleaved, png, scene
from making_recordings import TYPES as ROS1
from making_ros2 import INFO, SCAN, TYPES, K, as_cdr, field, foxglove, info, rig, scan, write_mcap, write_ros2
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from workers.readers.detect import open_recording
from workers.readers.recording import Frame, ReadError, ReadOptions, Sweep
from workers.readers.ros.rosbag2 import Rosbag2Recording

REAL = DATA / "vlp16-ros2" / "1673400471837873222"


def read(path, options=None):
    recording = open_recording(path, options) if path.is_file() else Rosbag2Recording(path, options or ReadOptions())
    assert isinstance(recording, Rosbag2Recording)
    try:
        items = [item for _, item in recording.messages(recording.sensors)]
        return recording, items, recording.warnings
    finally:
        recording.close()


def check_rig(items, count=5):
    sweeps = [item for item in items if isinstance(item, Sweep)]
    frames = [item for item in items if isinstance(item, Frame)]
    columns = scene()
    assert (len(sweeps), len(frames)) == (count, count)
    for i, (sweep, frame) in enumerate(zip(sweeps, frames, strict=True)):
        assert sweep.stamp_ns == START_NS + i * PERIOD_NS
        np.testing.assert_array_equal(sweep.xyz, np.stack([columns[a] for a in "xyz"], 1).astype(np.float32))
        np.testing.assert_array_equal(sweep.ring, columns["ring"])
        np.testing.assert_allclose(sweep.offset_ns, columns["time"] * 1e9, atol=10)
        assert (frame.width, frame.height, frame.media_type) == (8, 6, "image/png")
    return frames


def failure(path):
    with pytest.raises(ReadError) as caught:
        read(path)
    assert caught.value.hint
    return caught.value


@pytest.mark.parametrize(
    ("storage", "compress", "bare"),
    [
        *(("sqlite3", how, bare) for how in (None, "MESSAGE") for bare in (True, False)),
        ("sqlite3", "FILE", False),  # a packed file by itself is an archive
        *(("mcap", how, bare) for how in (None, "STORAGE") for bare in (True, False)),
    ],
)
def test_bags_of_ros_2(tmp_path, storage, compress, bare):
    path = write_ros2(tmp_path / "bag", rig(), storage, compress)
    if bare:
        (path,) = [file for file in path.iterdir() if file.name != "metadata.yaml"]
    recording, items, warnings = read(path)
    frames = check_rig(items)
    assert [f.data for f in frames] == [png(8, 6, i) for i in range(5)] and warnings == []
    lidar, camera = sorted(recording.sensors, key=lambda s: s.kind, reverse=True)
    assert (lidar.name, lidar.frame_id, lidar.count) == ("/points", "velodyne", 5)
    assert (camera.name, camera.frame_id, camera.count) == ("/front/image_raw/compressed", "camera", 5)
    assert camera.camera_info == {
        "model": "brown_conrady",
        "K": K,
        "D": [0.1, -0.2, 0.001, 0.002, 0.05],
        "distortion_model": "plumb_bob",
        "width": 1920,
        "height": 1208,
    }
    assert (camera.notes["width"], camera.notes["height"]) == ("8", "6")
    assert recording.other_topics == [f"/front/camera_info ({INFO})"]


def test_raw_images(tmp_path):
    _, items, _ = read(write_ros2(tmp_path / "bag", rig(raw=True)))
    assert all(frame.transcoded for frame in check_rig(items))


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


def test_a_bag_in_several_files(tmp_path):
    folder = write_ros2(tmp_path / "bag", rig(3), "mcap")
    (first,) = folder.glob("*.mcap")
    later = [(t, k, log + 3 * PERIOD_NS, m) for t, k, log, m in rig(2)]
    write_mcap(folder / "bag_1.mcap", as_cdr(later))
    text = (folder / "metadata.yaml").read_text().replace(f"- {first.name}", f"- {first.name}\n  - bag_1.mcap", 1)
    (folder / "metadata.yaml").write_text(text)
    recording, items, warnings = read(folder)
    assert len(items) == 10 and {s.count for s in recording.sensors} == {5} and warnings == []
    (folder / "bag_1.mcap").unlink()
    _, items, warnings = read(folder)
    assert len(items) == 6 and "1 of the bag's 2 files are missing" in warnings[0]
    first.unlink()
    error = failure(folder)
    assert error.code == "bag_incomplete" and first.name in error.message


def test_metadata_that_are_none(tmp_path):
    folder = write_ros2(tmp_path / "bag", rig(1))
    (folder / "metadata.yaml").write_text("- just a list\n")
    assert failure(folder).code == "bag_incomplete"


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


def scans(split=76, count=None, **how):
    stream = list(packets(**how))
    for number, start in enumerate(range(0, len(stream), split)):
        part = stream[start : start + split]
        arrived = [(moment + 1_327_104, data) for moment, data in part]
        yield "/packets", SCAN, arrived[-1][0] + number, scan(arrived[-1][0], arrived)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_packets_of_a_driver(tmp_path, storage):
    recording, sweeps, _ = read(write_ros2(tmp_path / "bag", scans(), storage))
    (sensor,) = recording.sensors
    assert (sensor.kind, sensor.frame_id) == ("lidar", "velodyne") and "ring" in sensor.notes["fields"]
    assert len(sweeps) == 4 and sum(len(s.xyz) for s in sweeps) == len(list(packets())) * 24 * 16
    assert all(abs(s.stamp_ns - START_NS - i * 100_000_000) < 150_000 for i, s in enumerate(sweeps))


def test_packets_without_stamps(tmp_path):
    def unstamped():
        for topic, kind, log_ns, message in scans():
            message.header.stamp.sec = message.header.stamp.nanosec = 0
            for packet in message.packets:
                packet.stamp.sec = packet.stamp.nanosec = 0
            yield topic, kind, log_ns, message

    _, sweeps, warnings = read(write_ros2(tmp_path / "bag", unstamped()))
    assert len(sweeps) == 4 and all(abs(s.stamp_ns - START_NS - i * 10**8) < 150_000 for i, s in enumerate(sweeps))
    assert "no stamp of their own" in warnings[0]


@pytest.mark.parametrize(
    ("how", "model", "d"),
    [
        ({"model": "equidistant", "d": (0.1, 0.2, 0.3, 0.4)}, "kannala_brandt", [0.1, 0.2, 0.3, 0.4]),
        ({"model": "fisheye", "d": ()}, "kannala_brandt", [0.0] * 4),
        ({"model": "plumb_bob", "d": ()}, "brown_conrady", [0.0] * 5),
        ({"model": "rational_polynomial", "d": (0.1, 0, 0, 0, 0, 0, 0, 0)}, "brown_conrady", [0.1, 0, 0, 0, 0]),
        ({"model": "rational_polynomial", "d": (0.1, 0, 0, 0, 0, 9, 0, 0)}, None, [0.1, 0, 0, 0, 0, 9, 0, 0]),
    ],
)
def test_lens_models_have_our_names(tmp_path, how, model, d):
    messages = [m for m in rig(1) if m[1] == COMPRESSED] + [("/front/camera_info", INFO, 1, info(START_NS, **how))]
    recording, _, _ = read(write_ros2(tmp_path / "bag", messages))
    assert (recording.sensors[0].camera_info["model"], recording.sensors[0].camera_info["D"]) == (model, d)


def test_an_uncalibrated_camera_states_nothing(tmp_path):
    messages = [m for m in rig(1) if m[1] == COMPRESSED] + [
        ("/front/camera_info", INFO, 1, info(START_NS, k=[0.0] * 9))
    ]
    recording, _, _ = read(write_ros2(tmp_path / "bag", messages))
    assert recording.sensors[0].camera_info is None


def test_topics_without_messages(tmp_path):
    path = tmp_path / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic, kind in (("/points", CLOUD), ("/packets", SCAN), ("/cam/image", COMPRESSED), ("/cam/info", INFO)):
            writer.add_connection(topic, kind, typestore=TYPES)
    recording = Rosbag2Recording(path, ReadOptions())
    assert [(s.kind, s.name, s.count) for s in recording.sensors] == [
        ("lidar", "/points", 0),
        ("lidar", "/packets", 0),
        ("camera", "/cam/image", 0),
    ]
    with pytest.raises(ReadError) as caught:
        recording.lidar_facts(recording.sensors[0])
    assert caught.value.code == "no_sweeps" and list(recording.messages(recording.sensors[2:])) == []
    recording.close()


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


@pytest.mark.parametrize("rest", [b"", bytes(100), b"\1" + bytes(7)])
def test_an_mcap_file_with_nothing_in_it(tmp_path, rest):
    (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n" + rest)
    assert failure(tmp_path / "a.mcap").code == "recording_empty"


def test_another_sqlite_file(tmp_path):
    import sqlite3

    db = sqlite3.connect(tmp_path / "a.db3")
    db.execute("CREATE TABLE people (name TEXT)")
    db.commit()
    db.close()
    assert failure(tmp_path / "a.db3").code == "not_a_recording"


@pytest.mark.parametrize(("number", "stamp"), [("'one'", "5"), ("NULL", "5"), ("x'00ff'", "5"), ("1", "'noon'")])
def test_a_table_with_values_of_the_wrong_kind_is_damaged_in_plain_words(tmp_path, number, stamp):
    import sqlite3

    db = sqlite3.connect(tmp_path / "a.db3")
    db.execute("CREATE TABLE topics (id, name, type, serialization_format)")
    db.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    db.execute(f"INSERT INTO topics VALUES ({number}, '/points', 'sensor_msgs/msg/PointCloud2', 'cdr')")
    db.execute(f"INSERT INTO messages VALUES (1, {number}, {stamp}, x'00010000')")
    db.commit()
    db.close()
    error = failure(tmp_path / "a.db3")
    assert error.code == "recording_damaged" and "contradict each other" in error.message
    assert not any(word in error.message for word in ("Error", "()", "NoneType", "literal"))


@pytest.mark.parametrize("kind", ["mcap", "json", "sqlite3"])
def test_damage_anywhere_is_a_clear_answer(tmp_path, kind):
    if kind == "sqlite3":
        (path,) = write_ros2(tmp_path / "bag", rig(3)).glob("*.db3")
    else:
        messages = as_cdr(rig(3)) if kind == "mcap" else [*foxglove(), *foxglove(encoding="json")]
        path = write_mcap(tmp_path / "a.mcap", messages, compression=CompressionType.NONE)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    codes = set()
    for _ in range(60):
        data = bytearray(whole)
        start = int(rng.integers(16, len(data) - 16))
        data[start : start + 16] = rng.integers(0, 255, 16, np.uint8).tobytes()
        path.write_bytes(data)
        try:
            read(path)
        except ReadError as error:
            assert error.hint
            codes.add(error.code)
    assert "recording_damaged" in codes


@pytest.mark.parametrize("bare", [True, False])
def test_the_real_bag(bare):
    if not REAL.exists():
        pytest.skip("real data is not here: ../shared/data/vlp16-ros2")
    from pypcd4 import PointCloud
    from scipy.spatial import cKDTree

    recording, sweeps, warnings = read(next(REAL.glob("*.db3")) if bare else REAL)
    assert [len(s.xyz) for s in sweeps] == [14547, 14513, 14542, 14576] and warnings == []
    facts = recording.lidar_facts(recording.sensors[0])
    assert facts.ring_count == 16 and any("dual return" in note for note in facts.notes)
    assert not any((s.ring == 0).any() for s in sweeps)
    published = PointCloud.from_path(REAL.parent / "1673400472138016708.pcd").pc_data
    # The published cloud is not quite what the packets say. It leaves out the heights of the lasers (at most 11.2 mm;
    # the maker's manual states them, ROS drivers put them in), and in the last two blocks of each packet it does not
    # turn the azimuth on from firing to firing (up to 0.33 degrees). With the heights put in, the rest agrees.
    height = np.array([11.2, 9.7, 8.1, 6.6, 5.1, 3.7, 2.2, 0.7]) / 1000
    points = np.stack([published["x"], published["y"], published["z"]], 1).astype(np.float64)
    plain, _ = cKDTree(sweeps[3].xyz).query(points)
    points[:, 2] += np.r_[height, -height[::-1]][published["channel"]]
    early = published["time_stamp"] < 20 * 55_296
    distance, _ = cKDTree(sweeps[3].xyz).query(points[early])
    assert np.median(distance) < 0.001 and np.mean(distance < 0.005) > 0.965
    assert np.median(plain) < 0.0055
