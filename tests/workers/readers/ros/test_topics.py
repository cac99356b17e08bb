"""What is particular to bags of ROS and to MCAP files."""

import struct

import cv2
import numpy as np
import pytest
from formats import folder_of, frames_of, read, same, sweeps_of, tar_of
from making_packets import packets
from making_recordings import CLOUD, COMPRESSED, IMAGE, PERIOD_NS, START_NS, cloud, raw_image, scene, write_bag
from making_recordings import TYPES as ROS1
from making_ros2 import INFO, SCAN, TYPES, K, as_cdr, foxglove, info, rig, scan, write_mcap, write_ros2
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from workers.readers.detect import open_recording
from workers.readers.recording import ReadError

PACKET_NS = 1_327_104
STATED = {"R": None, "P": None, "width": 1920, "height": 1208}
LENS = {"model": "brown_conrady", "K": K, "D": [0.1, -0.2, 0.001, 0.002, 0.05], "distortion_model": "plumb_bob"}


def test_what_a_bag_says_of_its_sensors(tmp_path):
    recording, items, _ = read(write_ros2(tmp_path / "bag", rig(3, raw=True)))
    lidar, camera = sorted(recording.sensors, key=lambda s: s.kind, reverse=True)
    assert (lidar.name, lidar.frame_id, lidar.count) == ("/points", "velodyne", 3)
    assert (camera.name, camera.frame_id, camera.count) == ("/front/image_raw", "camera", 3)
    assert camera.camera_info == LENS | STATED and camera.image_kind == "raw"
    assert (camera.notes["width"], camera.notes["height"]) == ("8", "6")
    assert recording.other_topics == [f"/front/camera_info ({INFO})"]
    assert all(frame.transcoding for frame in frames_of(items)) and len(items) == 6


def test_foxgloves_sensors(tmp_path):
    recording, items, _ = read(write_mcap(tmp_path / "a.mcap", foxglove()))
    assert {(s.kind, s.name, s.frame_id) for s in recording.sensors} == {
        ("lidar", "/lidar", "velodyne"),
        ("camera", "/front/image", "camera"),
        ("camera", "/left/image", "left"),
    }
    stated = {s.name: s.camera_info for s in recording.sensors}
    assert stated["/left/image"] is None and sum(bool(frame.transcoding) for frame in frames_of(items)) == 3
    assert (stated["/front/image"]["model"], stated["/front/image"]["D"]) == ("kannala_brandt", [0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize("form", ["rosbag1", "sqlite3", "mcap"])
def test_packets_of_a_driver_with_and_without_stamps(tmp_path, form):
    stream = list(packets())

    def scans(has_stamps, types):
        for start in range(0, len(stream), 76):
            part = [(moment + PACKET_NS, data) for moment, data in stream[start : start + 76]]
            log_ns = part[-1][0]
            message = scan(log_ns, part, types)
            for one in () if has_stamps else (message.header, *message.packets):
                one.stamp.sec = one.stamp.nanosec = 0
            yield "/packets", SCAN, log_ns, message

    for has_stamps in (True, False):
        path = tmp_path / f"bag{has_stamps}"
        if form == "rosbag1":
            recording, sweeps, warnings = read(write_bag(path, scans(has_stamps, ROS1)))
        else:
            recording, sweeps, warnings = read(write_ros2(path, scans(has_stamps, TYPES), form))
        (sensor,) = recording.sensors
        assert (sensor.kind, sensor.frame_id) == ("lidar", "velodyne") and "ring" in sensor.notes["fields"]
        assert len(sweeps) == 4 and sum(len(sweep.xyz) for sweep in sweeps) == len(stream) * 24 * 16
        assert all(abs(sweep.stamp_ns - START_NS - i * 10**8) < 150_000 for i, sweep in enumerate(sweeps))
        assert [("no stamp of their own" in line) for line in warnings] == ([] if has_stamps else [True])


@pytest.mark.parametrize(
    ("how", "model", "d"),
    [
        ({"model": "equidistant", "d": (0.1, 0.2, 0.3, 0.4)}, "kannala_brandt", [0.1, 0.2, 0.3, 0.4]),
        ({"model": "fisheye", "d": ()}, "kannala_brandt", [0.0] * 4),
        ({"model": "plumb_bob", "d": ()}, "brown_conrady", [0.0] * 5),
        ({"model": "rational_polynomial", "d": (0.1, 0, 0, 0, 0, 0, 0, 0)}, "brown_conrady", [0.1, 0, 0, 0, 0]),
        (
            {"model": "rational_polynomial", "d": (0.1, 0, 0, 0, 0, 9, 0, 0)},
            *("rational_polynomial", [0.1, 0, 0, 0, 0, 9, 0, 0]),
        ),
        ({"model": "rational_polynomial", "d": (0.1, *[0] * 7, 1e-3)}, None, [0.1, *[0] * 7, 1e-3]),
        ({"k": [0.0] * 9}, None, None),
    ],
)
def test_lens_models_have_our_names_and_an_uncalibrated_camera_none(tmp_path, how, model, d):
    messages = [m for m in rig(1) if m[1] == COMPRESSED] + [("/front/camera_info", INFO, 1, info(START_NS, **how))]
    stated = read(write_ros2(tmp_path / "bag", messages))[0].sensors[0].camera_info
    assert (stated and (stated["model"], stated["D"])) == (d and (model, d))


def test_rows_of_a_raw_image_may_be_padded(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 255, (6, 8, 3), np.uint8)
    path = write_bag(tmp_path / "a", [("/image", IMAGE, START_NS, raw_image(START_NS, pixels, "rgb8", step=32))])
    _, (frame,), _ = read(path)
    assert (cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR_RGB) == pixels).all()


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
    made, uuid, names = types.types, ("an id",) if newer else (), ("x", "y", "z", "ring")
    points = np.stack([scene()[name].astype("<f4") for name in names], 1)
    fields = [made["foxglove_msgs/msg/PackedElementField"](name, 4 * i, 7, *uuid) for i, name in enumerate(names)]
    origin = (made["geometry_msgs/msg/Point"](0, 0, 0), made["geometry_msgs/msg/Quaternion"](0, 0, 0, 1))
    time = made["builtin_interfaces/msg/Time"](*divmod(START_NS, 10**9))
    data = points.view(np.uint8).reshape(-1)
    message = made[kind](time, "lidar", made["geometry_msgs/msg/Pose"](*origin), 16, fields, data, *uuid)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/lidar", kind, typestore=types)
        writer.write(connection, START_NS, types.serialize_cdr(message, kind))
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
    other = " ".join(recording.other_topics)
    assert "encoded as flatbuffer, which is not read" in other and "/imu (sensor_msgs/msg/Imu)" in other


def test_topics_without_messages(tmp_path):
    topics = {"/points": CLOUD, "/packets": SCAN, "/cam/image": COMPRESSED, "/cam/info": INFO}
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic, kind in topics.items():
            writer.add_connection(topic, kind, typestore=TYPES)
    recording = open_recording(tmp_path / "bag")
    kinds = {s.name: (s.kind, s.count) for s in recording.sensors}
    assert kinds == {"/points": ("lidar", 0), "/packets": ("lidar", 0), "/cam/image": ("camera", 0)}
    with pytest.raises(ReadError) as caught:
        recording.lidar_facts(recording.sensors[0])
    assert caught.value.code == "no_sweeps" and list(recording.messages(recording.sensors[2:])) == []
    recording.close()


def test_a_bag_in_several_files(tmp_path):
    folder = write_ros2(tmp_path / "bag", rig(3), "mcap")
    (first,) = folder.glob("*.mcap")
    write_mcap(
        folder / "bag_1.mcap", as_cdr((t, k, log + 3 * PERIOD_NS, m) for t, k, log, m in rig(2)), chunk_size=99
    )
    text = (folder / "metadata.yaml").read_text().replace(f"- {first.name}", f"- {first.name}\n  - bag_1.mcap", 1)
    (folder / "metadata.yaml").write_text(text)
    recording, items, warnings = read(folder)
    assert len(items) == 10 and {s.count for s in recording.sensors} == {5} and warnings == []
    whole = (folder / "bag_1.mcap").read_bytes()
    (folder / "bag_1.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    _, items, warnings = read(folder)
    assert 6 <= len(items) < 10 and "bag_1.mcap ends without its index" in warnings[0]
    (folder / "bag_1.mcap").unlink()
    _, items, warnings = read(folder)
    assert len(items) == 6 and "1 of the bag's 2 files are missing" in warnings[0]


def test_zeros_for_the_rest_of_a_page_are_no_message(tmp_path):
    """SQLite fills a page that is there in part with zeros: messages in it lose their end, or their number."""
    (path,) = write_ros2(tmp_path / "bag", rig(12)).glob("*.db3")
    whole = path.read_bytes()
    _, everything, _ = read(path)
    for size in range(len(whole) - 1, len(whole) // 2, -1193):
        path.write_bytes(whole[:size])
        _, items, _ = read(path)
        assert len(items) > 3 and all(map(same, items, everything))


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
    for place in rng.integers(start, len(whole) - 16, 30):
        path.write_bytes(whole[:place] + rng.bytes(16) + whole[place + 16 :])
        _, items, warnings = read(path)
        warned += any("The index of a.mcap is damaged" in line for line in warnings)
        assert len(items) == len(everything) and all(map(same, items, everything))
    assert warned > 20  # of the others the footer itself is damaged, which says where the index is


@pytest.mark.parametrize("change", [1, -1, 1 << 40, (1 << 63) - 1])
def test_an_index_without_a_checksum_that_names_no_chunk(tmp_path, change):
    path = write_mcap(tmp_path / "a.mcap", as_cdr(rig(20)), chunk_size=4000)
    _, everything, _ = read(path)
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
    assert len(items) == 40 and all(map(same, items, everything))
    assert any("The index of a.mcap is damaged" in line for line in warnings)


@pytest.mark.parametrize("kind", ["folder", "tar"])
def test_a_bag_that_was_split_is_one_recording(tmp_path, kind):
    files = {}
    for number in (9, 10):
        stamps = [START_NS + (number * 3 + i) * PERIOD_NS for i in range(3)]
        path = write_bag(tmp_path / "one.bag", [("/points", CLOUD, at, cloud(at, scene())) for at in stamps])
        files[f"walk_{number}.bag"] = path.read_bytes()
        path.unlink()
    if kind == "tar":
        (tmp_path / "walk").write_bytes(tar_of(files))
    else:
        folder_of(tmp_path / "walk", files)
    recording, items, warnings = read(tmp_path / "walk")
    assert [(s.kind, s.name, s.count) for s in recording.sensors] == [("lidar", "/points", 6)]
    assert [sweep.stamp_ns for sweep in sweeps_of(items)] == [START_NS + i * PERIOD_NS for i in range(27, 33)]
    assert warnings == ["2 files with the same topics were read one after the other."]


def test_parts_with_other_rings_are_refused(tmp_path):
    for number, rings in enumerate((16, 32)):
        stamp = START_NS + number * PERIOD_NS
        write_bag(tmp_path / f"walk_{number}.bag", [("/points", CLOUD, stamp, cloud(stamp, scene(rings)))] * 2)
    recording = open_recording(tmp_path)
    with pytest.raises(ReadError, match="16, 32"):
        recording.lidar_facts(recording.sensors[0])
    recording.close()
