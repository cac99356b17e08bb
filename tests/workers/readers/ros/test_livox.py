"""Livox's CustomMsg in each kind of bag; what is right is written here field by field, by rosbags' own classes."""

import numpy as np
import pytest
from formats import read, sweeps_of
from making_recordings import START_NS, TYPES, header, images, interleaved, png, write_bag
from making_ros2 import TYPES as ROS2
from making_ros2 import as_cdr, rig, write_mcap, write_ros2
from rosbags.typesys import get_types_from_msg

from apexcal.documents.readings import ReadOptions
from workers.readers.inspection import inspect_recording
from workers.readers.recording import ReadError
from workers.readers.ros.livox import read_livox_cloud

_TEXT = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\nCustomPoint[] points\n"
    + "=" * 80
    + "\nMSG: {0}/CustomPoint\nuint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n"
    "uint8 reflectivity\nuint8 tag\nuint8 line\n"
)
PACKAGES = ("livox_ros_driver", "livox_ros_driver2", "livox_interfaces")
for store in (TYPES, ROS2):
    for package in PACKAGES:
        store.register(get_types_from_msg(_TEXT.format(package), f"{package}/msg/CustomMsg"))
COUNT, STEP_NS = 2000, 50_000


def points(seed=0):
    """A rosette, seen by six lines in turn; a tenth has no return. Tags are of returns and of noise of all kinds."""
    rng = np.random.default_rng(seed)
    angle = np.cumsum(rng.uniform(0.0, 0.05, COUNT))
    radius = np.radians(35.0) * np.sin(3.618 * angle)
    azimuth, elevation = radius * np.cos(angle), radius * np.sin(angle)
    distance = np.where(rng.random(COUNT) < 0.1, 0.0, rng.uniform(3.0, 30.0, COUNT))
    xyz = distance[:, None] * np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1
    )
    return xyz.astype(np.float32), rng.choice([0, 16, 32, 48, 1, 2, 3, 4, 8, 12, 17, 36], COUNT)


# By the manual: bits 0 and 1, then 2 and 3: 1 and 2 are noise; 16, 32 and 48 are the number of the return.
NORMAL = (0, 16, 32, 48, 3, 12)


def custom(stamp_ns, base_ns, xyz, tags, types, package, frame_id="livox_frame"):
    point = types.types[f"{package}/msg/CustomPoint"]
    each = [
        point(i * STEP_NS, *(np.float32(v) for v in xyz[i]), i % 250, int(tags[i]), i % 6) for i in range(len(xyz))
    ]
    kind = types.types[f"{package}/msg/CustomMsg"]
    return kind(header(stamp_ns, frame_id, types), base_ns, len(xyz), 3, np.zeros(3, np.uint8), each)


def written(folder, form, package, base_ns=lambda stamp: stamp, count=3):
    types = TYPES if form == "rosbag1" else ROS2
    kind = f"{package}/msg/CustomMsg"
    stamps = [START_NS + i * 100_000_000 for i in range(count)]
    clouds = [("/livox/lidar", kind, s, custom(s, base_ns(s), *points(), types, package)) for s in stamps]
    if form == "rosbag1":
        return write_bag(folder / "walk.bag", interleaved(clouds, images(count)))
    cameras = [message for message in rig(count) if message[0] != "/points"]
    for *_, message in (each for each in cameras if each[0].endswith("compressed")):
        message.data = np.frombuffer(png(64, 48), np.uint8)
    if form == "mcap":
        return write_mcap(folder / "walk.mcap", as_cdr(interleaved(clouds, cameras)))
    return write_ros2(folder / "walk", interleaved(clouds, cameras))


@pytest.mark.parametrize("package", PACKAGES)
@pytest.mark.parametrize("form", ["rosbag1", "db3", "mcap"])
def test_points_times_and_reflectivity_are_read_without_noise(tmp_path, form, package):
    recording, items, _ = read(written(tmp_path, form, package))
    xyz, tags = points()
    kept = np.isin(tags, NORMAL) & xyz.any(1)
    sweeps = sweeps_of(items)
    assert len(sweeps) == 3 and 500 < kept.sum() < COUNT
    for sweep in sweeps:
        np.testing.assert_array_equal(sweep.xyz, xyz[kept])
        assert sweep.intensity.tolist() == (np.arange(COUNT) % 250)[kept].tolist()
        assert sweep.offset_ns.tolist() == (np.arange(COUNT) * STEP_NS)[kept].tolist() and not sweep.ring.any()
    (lidar,) = [each for each in recording.sensors if each.kind == "lidar"]
    facts = recording.lidar_facts(lidar)
    assert facts.ring_count == 1 and lidar.frame_id == "livox_frame"
    assert any("--still" in note for note in facts.notes)


def test_inspect_says_what_a_sensor_without_rings_needs(tmp_path):
    path = written(tmp_path, "mcap", "livox_ros_driver2", count=8)
    (fault,) = [fault for fault in inspect_recording(path).faults if fault.code == "no_rings"]
    assert fault.verdict == "look" and "--still" in fault.remedy
    still = inspect_recording(path, options=ReadOptions(point_times="stamp_only"))
    assert not any(fault.code == "no_rings" for fault in still.faults)


@pytest.mark.parametrize("base", [0, 77_000_000_000])
def test_a_base_time_of_the_sensor_s_own_clock_puts_its_first_point_at_the_stamp(tmp_path, base):
    """Without PTP the base time counts from the sensor's start."""
    path = written(tmp_path, "db3", "livox_ros_driver2", lambda stamp: base + stamp - START_NS)
    xyz, tags = points()
    times = (np.arange(COUNT) * STEP_NS)[np.isin(tags, NORMAL) & xyz.any(1)]
    for sweep in sweeps_of(read(path)[1]):
        assert sweep.offset_ns.tolist() == (times - times[0]).tolist()


@pytest.mark.parametrize("frame_id", ["", "a", "ab", "abc", "abcd", "livox", "a_longer_name_of_a_frame"])
@pytest.mark.parametrize("form", ["ros1", "cdr"])
def test_a_name_of_any_length_stands_before_the_points(form, frame_id):
    types = TYPES if form == "ros1" else ROS2
    xyz, _ = points()
    message = custom(START_NS + 5, START_NS, xyz[:7], np.zeros(7, int), types, "livox_ros_driver2", frame_id)
    pack = types.serialize_ros1 if form == "ros1" else types.serialize_cdr
    raw = bytes(pack(message, "livox_ros_driver2/msg/CustomMsg"))
    cloud = read_livox_cloud(raw, form)
    assert (cloud.stamp_ns, cloud.frame_id) == (START_NS + 5, frame_id)
    np.testing.assert_array_equal(np.column_stack([cloud.cloud[axis] for axis in "xyz"]), xyz[:7])
    assert cloud.cloud["time"].tolist() == [START_NS + i * STEP_NS for i in range(7)]
    with pytest.raises(ValueError, match="do not hold 7 points"):
        read_livox_cloud(raw[:-3], form)


def test_a_message_that_claims_more_points_than_it_has_is_refused_in_words(tmp_path):
    claims = custom(START_NS, START_NS, *points(), ROS2, "livox_ros_driver2")
    kind = "livox_ros_driver2/msg/CustomMsg"
    raw = bytearray(ROS2.serialize_cdr(claims, kind))
    at = raw.index(np.uint32(COUNT).tobytes(), raw.index(np.uint32(COUNT).tobytes()) + 4)
    raw[at : at + 4] = b"\xff\xff\xff\xff"
    path = write_mcap(tmp_path / "walk.mcap", [("/livox/lidar", kind, "cdr", START_NS, bytes(raw))] * 3)
    with pytest.raises(ReadError) as caught:
        read(path, ReadOptions())
    assert caught.value.code == "recording_damaged"
