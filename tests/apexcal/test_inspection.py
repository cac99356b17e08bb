"""`apexcal inspect`: each fault of a recording is named, alone and nothing else, without a service."""

from __future__ import annotations

import struct
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from apexcal.documents.inspections import Inspection
from tests.apexcal.test_cli import apexcal

TYPES = get_typestore(Stores.ROS1_NOETIC)
INFO, TREE = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
SECOND = 10**9
# Topic, type, time of recording, message.
Message = tuple[str, str, int, bytes]
Edit = Callable[[Message], Iterable[Message]]


@pytest.fixture(scope="module")
def walk(tmp_path_factory) -> list[Message]:
    """Ten seconds of a walk with CameraInfo and ``/tf_static``."""
    folder = tmp_path_factory.mktemp("inspected") / "walk"
    words = ("--seconds", "10", "--camera-hz", "5", "--camera-info", "raw", "--json")
    command = [sys.executable, "-m", "workers.simulation", "--out", str(folder), *words]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with Reader(folder / "recording.bag") as bag:
        for each in bag.connections:
            if each.msgtype not in TYPES.types:
                TYPES.register(get_types_from_msg(each.msgdef.data, each.msgtype))
        return [(each.topic, each.msgtype, time, bytes(raw)) for each, time, raw in bag.messages()]


def write(path: Path, messages: Iterable[Message]) -> Path:
    connections = {}
    with Writer(path) as bag:
        for topic, kind, time, raw in messages:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=TYPES)
            bag.write(connections[topic], time, raw)
    return path


def inspected(path: Path, *words: str) -> tuple[int, Inspection]:
    done = apexcal("inspect", path, *words, "--json")
    return done.returncode, Inspection.model_validate_json(done.stdout)


def is_camera(message: Message) -> bool:
    return "mage" in message[1] or message[1] == INFO


def edited(kind: str, change: Callable[[object], None]) -> Edit:
    """All messages of a type, changed."""

    def edit(message: Message) -> Iterable[Message]:
        topic, of, time, raw = message
        if of == kind:
            document = TYPES.deserialize_ros1(raw, of)
            change(document)
            raw = bytes(TYPES.serialize_ros1(document, of))
        yield topic, of, time, raw

    return edit


def dropped(is_dropped: Callable[[Message], bool]) -> Edit:
    return lambda message: () if is_dropped(message) else (message,)


def shifted(stamp_s: int, log_s: int) -> Edit:
    """Cameras with another clock, or recorded at another time. A header begins with seq and seconds."""

    def edit(message: Message) -> Iterable[Message]:
        topic, kind, time, raw = message
        if is_camera(message):
            raw = raw[:4] + struct.pack("<I", struct.unpack_from("<I", raw, 4)[0] + stamp_s) + raw[8:]
            time += log_s * SECOND
        yield topic, kind, time, raw

    return edit


def no_lens(info) -> None:
    info.K = 0.0 * info.K


def half_size(info) -> None:
    info.width, info.height = info.width // 2, info.height // 2


def wide_lens(info) -> None:
    info.K = 9.0 * info.K


def other_tree(tree) -> None:
    for each in tree.transforms:
        if "camera" in each.child_frame_id or "optical" in each.child_frame_id:
            each.header.frame_id = f"elsewhere_{each.header.frame_id}"


def after(seconds: float, end: float = 1e9) -> Callable[[Message, int], bool]:
    return lambda message, first: first + seconds * SECOND < message[2] < first + end * SECOND


FAULTS: dict[str, tuple[Edit, str, int]] = {
    "no CameraInfo": (dropped(lambda m: m[1] == INFO), "no_camera_info", 1),
    "K of zeros": (edited(INFO, no_lens), "lens_not_stated", 1),
    "K of no lens": (edited(INFO, wide_lens), "lens_not_plausible", 1),
    "wrong size": (edited(INFO, half_size), "image_size_differs", 2),
    "clocks apart": (shifted(30, 0), "clocks_apart", 2),
    "no overlap": (shifted(60, 60), "no_overlap", 2),
    "little overlap": (shifted(8, 8), "little_overlap", 1),
    "no frame in common": (edited(TREE, other_tree), "frames_not_connected", 1),
    "no images": (dropped(is_camera), "no_camera", 2),
}
TIMED = {
    "gap of the camera": (lambda m, first: is_camera(m) and after(4, 6)(m, first), "gap", 1),
    "gap of the LiDAR": (lambda m, first: "Cloud" in m[1] and after(4, 6)(m, first), "gap", 1),
    "3 s long": (after(3), "too_short", 1),
    "a moment long": (lambda m, first: m[1] != TREE and after(0.35)(m, first), "too_few", 2),
}


def test_a_good_walk_lacks_nothing_and_is_told_as_it_is(walk, tmp_path):
    code, inspection = inspected(write(tmp_path / "walk.bag", walk))
    lidar, camera = inspection.sensors
    assert code == 0 and inspection.faults == [] and inspection.is_connected is True
    assert inspection.calibratable == [camera.name]
    assert (lidar.count, camera.count) == (100, 50)
    assert lidar.rate_hz == pytest.approx(10.0, abs=0.1) and camera.rate_hz == pytest.approx(5.0, abs=0.1)
    assert camera.image_kind == "raw" and camera.states_lens and camera.image_size
    shown = apexcal("inspect", tmp_path / "walk.bag")
    assert shown.returncode == 0 and f"It can calibrate {camera.name}." in shown.stdout


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_named_and_nothing_else(walk, tmp_path, name):
    edit, fault, code = FAULTS[name]
    messages = sorted((each for message in walk for each in edit(message)), key=lambda message: message[2])
    check(write(tmp_path / "walk.bag", messages), fault, code)


@pytest.mark.parametrize("name", TIMED)
def test_each_fault_in_time_is_named_and_nothing_else(walk, tmp_path, name):
    is_dropped, fault, code = TIMED[name]
    first = walk[0][2]
    check(write(tmp_path / "walk.bag", [each for each in walk if not is_dropped(each, first)]), fault, code)


def check(path: Path, fault: str, code: int) -> None:
    found, inspection = inspected(path)
    assert {each.code for each in inspection.faults} == {fault}, inspection.faults
    assert found == code
    assert bool(inspection.calibratable) == (code == 1)
    assert all(each.sentence.endswith(".") and each.remedy for each in inspection.faults)


def test_still_poses_are_not_too_short_where_they_are_said_to_be_still(walk, tmp_path):
    path = write(tmp_path / "poses.bag", [each for each in walk if not after(3)(each, walk[0][2])])
    assert inspected(path, "--still")[0] == 0


def test_what_is_no_recording_or_not_clear_is_2_with_what_to_do(walk, tmp_path):
    (tmp_path / "notes.txt").write_text("no recording")
    refused = apexcal("inspect", tmp_path / "notes.txt")
    assert refused.returncode == 2 and "(not_a_recording)" in refused.stderr and "Upload" in refused.stderr
    twice = [each for topic, *rest in walk for each in ((topic, *rest), (f"/other{topic}", *rest))]
    asked = apexcal("inspect", write(tmp_path / "two.bag", twice))
    assert asked.returncode == 2 and "(ambiguous_lidar)" in asked.stderr and "apexcal inspect" in asked.stderr
    assert "Traceback" not in refused.stderr + asked.stderr


@pytest.mark.parametrize("suffix", ["mcap", "sqlite3"])
def test_a_ros_2_bag_is_told_as_the_ros_1_bag_is(walk, tmp_path, suffix):
    """By the index of either; the messages are the same."""
    from rosbags.convert import convert

    source = write(tmp_path / "walk.bag", walk)
    code, inspection = inspected(source)
    target = tmp_path / "ros2"
    none = dict.fromkeys(("exclude_topics", "include_topics", "exclude_msgtypes", "include_msgtypes"), ())
    how = {"compress": None, "compress_mode": "none", "default_typestore": None, "typestore": None}
    convert([source], target, dst_storage=suffix, dst_version=9, **how, **none)
    again, converted = inspected(target)
    assert again == code
    for ours, theirs in zip(inspection.sensors, converted.sensors, strict=True):
        assert theirs.delay_s == pytest.approx(ours.delay_s, abs=0.05)
        assert theirs.model_dump(exclude={"delay_s"}) == ours.model_dump(exclude={"delay_s"})
    assert not converted.faults
