"""What /tf_static of a bag says reaches the manifest, in ROS 1 and ROS 2; broken ones are left out with a word."""

import numpy as np
import pytest
from making_recordings import START_NS, clouds, images, interleaved, write_bag
from making_recordings import TYPES as ROS1
from making_ros2 import TYPES as ROS2
from making_ros2 import as_cdr, rig, write_mcap, write_ros2
from making_transforms import CAMERA, LIDAR, TF, message

from workers.readers.detect import open_recording
from workers.readers.normalised.manifest import RecordingManifest
from workers.readers.normalised.normalise import normalise


def told(recording):
    try:
        return {(one.parent, one.child): one for one in recording.static_transforms}, recording.warnings
    finally:
        recording.close()


@pytest.fixture(params=["rosbag1", "sqlite3", "mcap", "bare mcap"])
def bag(request, tmp_path):
    def write(*stated, topic="/tf_static"):
        types = ROS1 if request.param == "rosbag1" else ROS2
        said = [(topic, TF, START_NS + 7 * place, message(types, one)) for place, one in enumerate(stated)]
        if request.param == "rosbag1":
            return write_bag(tmp_path / "walk.bag", interleaved(clouds(), images(), said))
        messages = interleaved(rig(), said)
        if request.param == "bare mcap":
            return write_mcap(tmp_path / "walk.mcap", as_cdr(messages))
        return write_ros2(tmp_path / "walk", messages, request.param)

    return write


def test_every_node_says_its_own_and_the_later_word_counts(bag, tmp_path):
    moved = (*LIDAR[:2], (1.3, 0.0, 1.9), LIDAR[3])
    path = bag([LIDAR], [CAMERA], [moved])
    found, warnings = told(open_recording(path))
    assert set(found) == {("base_link", "velodyne"), ("base_link", "camera")} and not warnings
    assert found["base_link", "velodyne"].translation_m == [1.3, 0.0, 1.9]
    assert found["base_link", "camera"].quaternion_xyzw == [-0.5, 0.5, -0.5, 0.5]
    manifest = normalise(path, tmp_path / "out")
    again = RecordingManifest.model_validate(manifest.model_dump(mode="json"))
    assert [one["child"] for one in again.facts()["static_transforms"]] == ["velodyne", "camera"]


def test_what_is_no_transform_is_left_out(bag):
    nothing, turned = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    odd = [
        ("a", "a", nothing, turned),
        ("a", "", nothing, turned),
        ("a", "b", (np.nan, 0.0, 0.0), turned),
        ("a", "c", nothing, (0.0, 0.0, 0.0, 0.0)),
        ("a", "d", (1e9, 0.0, 0.0), turned),
        ("a", "e\n", nothing, turned),
    ]
    found, _ = told(open_recording(bag([*odd, LIDAR])))
    assert set(found) == {("base_link", "velodyne")}


def test_moving_transforms_are_not_fixed(bag):
    assert told(open_recording(bag([LIDAR], topic="/tf"))) == ({}, [])


def test_a_broken_message_is_left_out_with_a_word(tmp_path):
    messages = [*as_cdr(rig()), ("/tf_static", TF, "cdr", START_NS, b"\0\1\0\0\xff\xff\xff\xff")]
    path = write_mcap(tmp_path / "walk.mcap", messages)
    found, warnings = told(open_recording(path))
    assert not found
    manifest = normalise(path, tmp_path / "out")
    assert any("/tf_static was left out" in said for said in manifest.warnings), warnings
