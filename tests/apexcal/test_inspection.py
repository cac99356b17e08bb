"""`apexcal inspect`: each fault of a recording is named, alone and nothing else, without a service."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from apexcal.documents.fleets import NewRig
from apexcal.documents.inspections import Inspection
from apexcal.geometry.se3 import from_document
from apexcal.rigs import read_rig
from tests.apexcal.test_cli import apexcal
from tests.support import walks
from workers.readers import __main__ as reader

TYPES = get_typestore(Stores.ROS1_NOETIC)
INFO, TREE = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
SECOND = 10**9
# Topic, type, time of recording, message.
Message = tuple[str, str, int, bytes]
Edit = Callable[[Message], Iterable[Message]]


@pytest.fixture(scope="module")
def folder() -> Path:
    """A walk with CameraInfo, ``/tf_static`` and a URDF."""
    return walks.walk("with-tree")


@pytest.fixture(scope="module")
def walk(folder) -> list[Message]:
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


def inspected(path: Path, **request: object) -> Inspection:
    """What the child of the command says, in this process: each child costs a second."""
    return reader.inspected(path, request)


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
    "clocks apart": (shifted(30, 0), "clocks_apart", 1),
    "no overlap": (shifted(60, 60), "no_overlap", 2),
    "little overlap": (shifted(10, 10), "little_overlap", 1),
    "no frame in common": (edited(TREE, other_tree), "frames_not_connected", 1),
    "no images": (dropped(is_camera), "no_camera", 2),
}
# What is left out of the walk: (message, its first moment).
TIMED = {
    "gap of the camera": (lambda m, first: is_camera(m) and after(4, 6)(m, first), "gap", 1),
    "3 s long": (after(3), "too_short", 1),
    "a moment long": (lambda m, first: m[1] != TREE and after(0.35)(m, first), "too_few", 2),
}


def test_a_good_walk_lacks_nothing_and_is_told_as_it_is(walk, tmp_path):
    told = apexcal("inspect", write(tmp_path / "walk.bag", walk), "--json")
    inspection = Inspection.model_validate_json(told.stdout)
    lidar, camera = inspection.sensors
    assert told.returncode == 0 and inspection.faults == [] and inspection.is_connected is True
    assert inspection.calibratable == [camera.name]
    assert (lidar.count, camera.count) == (120, 60)
    assert lidar.rate_hz == pytest.approx(10.0, abs=0.1) and camera.rate_hz == pytest.approx(5.0, abs=0.1)
    assert camera.image_kind == "raw" and camera.lens and camera.image_size
    shown = apexcal("inspect", tmp_path / "walk.bag")
    assert shown.returncode == 0 and f"It can calibrate {camera.name}." in shown.stdout


def test_a_file_beside_that_may_state_the_lens_is_named(walk, tmp_path):
    path = write(tmp_path / "walk.bag", [message for message in walk if message[1] != INFO])
    (tmp_path / "camera_info.yaml").write_text("image_width: 640\n")
    told = Inspection.model_validate_json(apexcal("inspect", path, "--json").stdout)
    assert [fault.code for fault in told.faults] == ["no_camera_info"]
    assert "read camera_info.yaml" in told.faults[0].remedy


def rig_of(path: Path, **request: object):
    """The proposed rig and what it leaves open."""
    proposal = inspected(path, **request).proposal
    assert proposal is not None
    return proposal.rig, [(each.asks, each.sensor, each.assumed) for each in proposal.questions]


def robot(urdf: str, time: int) -> Message:
    message = TYPES.types["std_msgs/msg/String"](urdf)
    return (
        "/robot_description",
        "std_msgs/msg/String",
        time,
        bytes(TYPES.serialize_ros1(message, "std_msgs/msg/String")),
    )


def test_a_recording_proposes_the_rig_that_its_owner_would_describe(walk, tmp_path, folder):
    described = json.loads((folder / "rig.json").read_text())
    rig, questions = rig_of(write(tmp_path / "walk.bag", walk))
    (camera,), (own,) = rig.cameras, described["cameras"]
    assert not questions and camera.name == own["name"]
    assert (rig.lidar.frame, rig.lidar.topic) == (described["lidar"]["frame"], described["lidar"]["topic"])
    assert (camera.frame, camera.topic, list(camera.image_size)) == (own["frame"], own["topic"], own["image_size"])
    assert camera.images is not None and camera.images.kind == "raw"
    assert apart(camera.nominal, own["nominal"]) < 1e-6
    assert rig.T_vehicle_lidar is not None and rig.T_vehicle_lidar.to_frame == "base_link"
    assert camera.joint is not None and camera.joint.T_child_camera.to_frame == "camera_front_link"


def test_without_tf_static_the_urdf_places_the_camera(walk, tmp_path, folder):
    """That of a file, or of the recording itself."""
    urdf = folder / "vehicle.urdf"
    bare = [each for each in walk if each[1] != TREE]
    path = write(tmp_path / "bare.bag", bare)
    assert rig_of(path)[1] == [("looks", "front", "forward")]
    own = json.loads((folder / "rig.json").read_text())["cameras"][0]
    itself = write(tmp_path / "walk.bag", [robot(urdf.read_text(), walk[0][2]), *bare])
    for rig, questions in (rig_of(path, urdf=urdf), rig_of(itself)):
        assert not questions and apart(rig.cameras[0].nominal, own["nominal"]) < 1e-6


def doubled(walk: list[Message]) -> list[Message]:
    """Each topic beside another of its kind."""
    return [each for topic, *rest in walk for each in ((topic, *rest), (f"/other{topic}", *rest))]


def test_two_lidars_are_told_apart_by_a_person_and_two_cameras_are_both_proposed(walk, tmp_path):
    path = write(tmp_path / "two.bag", doubled(walk))
    rig, questions = rig_of(path, lidar="/velodyne_points")
    assert rig.lidar.topic == "/velodyne_points" and [camera.name for camera in rig.cameras] == [
        "front",
        "other_front",
    ]
    # The second has the first one's frame, so it gets one of its own, which the tree does not have.
    assert [each[:2] for each in questions] == [("frames", "other_front")]


def test_what_inspect_writes_and_prints_is_taken_for_a_rig(walk, tmp_path):
    path, out = write(tmp_path / "walk.bag", walk), tmp_path / "rig.json"
    written = apexcal("inspect", path, "--rig-out", out)
    assert (
        written.returncode == 0 and "Proposed rig: lidar [velodyne], front [camera_front_optical]." in written.stdout
    )
    (tmp_path / "inspection.json").write_text(apexcal("inspect", path, "--json").stdout)
    of_file, of_answer = read_rig(out), read_rig(tmp_path / "inspection.json")
    assert NewRig.model_validate(of_file) == NewRig.model_validate(of_answer)
    assert apexcal("inspect", path, "--rig-out", out).returncode == 2, "it is there already"
    assert apexcal("inspect", path, "--looks", "front=up").returncode == 2
    wrong = apexcal("inspect", path, "--looks", "rear=left")
    assert wrong.returncode == 2 and "(frames_not_usable)" in wrong.stderr


def test_a_broken_robot_description_is_no_reason_to_refuse(walk, tmp_path):
    rig, questions = rig_of(write(tmp_path / "walk.bag", [robot("<robot", walk[0][2]), *walk]))
    assert not questions and rig.T_vehicle_lidar is not None


def apart(a, b) -> float:
    """The largest difference of two transforms' matrices."""
    return float(np.abs(from_document(a).matrix - from_document(b).matrix).max())


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
    inspection = inspected(path)
    assert {each.code for each in inspection.faults} == {fault}, inspection.faults
    assert bool(inspection.calibratable) == (code == 1)
    assert all(each.sentence.endswith(".") and each.remedy for each in inspection.faults)


def test_still_poses_are_not_too_short_where_they_are_said_to_be_still(walk, tmp_path):
    path = write(tmp_path / "poses.bag", [each for each in walk if not after(3)(each, walk[0][2])])
    assert [apexcal("inspect", path, *words).returncode for words in ((), ("--still",))] == [1, 0]


def test_what_is_no_recording_or_not_clear_is_2_with_what_to_do(walk, tmp_path):
    (tmp_path / "notes.txt").write_text("no recording")
    refused = apexcal("inspect", tmp_path / "notes.txt")
    assert refused.returncode == 2 and "(not_a_recording)" in refused.stderr and "Upload" in refused.stderr
    asked = apexcal("inspect", write(tmp_path / "two.bag", doubled(walk)))
    assert asked.returncode == 2 and "(ambiguous_lidar)" in asked.stderr and "apexcal inspect" in asked.stderr
    assert "Traceback" not in refused.stderr + asked.stderr


@pytest.mark.parametrize("suffix", ["mcap", "sqlite3"])
def test_a_ros_2_bag_is_told_as_the_ros_1_bag_is(walk, tmp_path, suffix):
    """By the index of either; the messages are the same."""
    from rosbags.convert import convert

    source = write(tmp_path / "walk.bag", walk)
    inspection = inspected(source)
    target = tmp_path / "ros2"
    none = dict.fromkeys(("exclude_topics", "include_topics", "exclude_msgtypes", "include_msgtypes"), ())
    how = {"compress": None, "compress_mode": "none", "default_typestore": None, "typestore": None}
    convert([source], target, dst_storage=suffix, dst_version=9, **how, **none)
    converted = inspected(target)
    for ours, theirs in zip(inspection.sensors, converted.sensors, strict=True):
        assert theirs.delay_s == pytest.approx(ours.delay_s, abs=0.05)
        assert theirs.model_dump(exclude={"delay_s"}) == ours.model_dump(exclude={"delay_s"})
    assert not converted.faults
