"""The bag as rosbags and as our own reader see it."""

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from workers.readers.detect import open_recording
from workers.readers.recording import Frame, Sweep
from workers.simulation.bag import POINT, BagWriter


def messages(path, topic):
    with AnyReader([path]) as bag:
        chosen = [connection for connection in bag.connections if connection.topic == topic]
        for connection, received_ns, raw in bag.messages(chosen):
            yield received_ns, bag.deserialize(raw, connection.msgtype)


def stamp_ns(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def test_rosbags_reads_every_sweep(short):
    clouds = list(messages(short.written.recording, "/velodyne_points"))
    assert len(clouds) == short.written.sweeps == 50
    received = [at for at, _ in clouds]
    assert received == sorted(received)
    for index, (at, cloud) in enumerate(clouds):
        expected = short.rig.lidar.sweep(index, (stamp_ns(cloud) - 1_780_000_000_000_000_000) * 1e-9, 0)
        assert cloud.header.frame_id == "velodyne"
        assert cloud.header.seq == index
        assert stamp_ns(cloud) == short.truth["sweeps"]["stamp_ns"][index]
        points = np.frombuffer(cloud.data, POINT)
        assert len(points) == cloud.width == len(expected.xyz)
        assert [field.name for field in cloud.fields] == list(POINT.names)
        np.testing.assert_array_equal(np.stack([points[axis] for axis in "xyz"], axis=1), expected.xyz)
        np.testing.assert_array_equal(points["ring"], expected.ring)
        np.testing.assert_allclose(points["time"], expected.offset_ns * 1e-9, rtol=1e-6)
        assert stamp_ns(cloud) + expected.offset_ns.max() <= at  # recorded after it was measured


def test_rosbags_reads_every_frame(short):
    frames = list(messages(short.written.recording, "/camera/front/image/compressed"))
    assert len(frames) == short.written.frames == len(short.truth["frames"]["stamp_ns"])
    for index, (at, frame) in enumerate(frames):
        assert frame.header.frame_id == "camera_front_optical"
        assert frame.format == "jpeg"
        assert stamp_ns(frame) == short.truth["frames"]["stamp_ns"][index] < at
    image = cv2.imdecode(frames[0][1].data, cv2.IMREAD_COLOR)
    assert image.shape == (600, 960, 3)


def test_our_reader_sees_what_was_simulated(short):
    recording = open_recording(short.written.recording)
    try:
        lidar = next(sensor for sensor in recording.sensors if sensor.kind == "lidar")
        for index, sweep in enumerate(recording.sweeps(lidar)):
            start_s = (sweep.stamp_ns - 1_780_000_000_000_000_000) * 1e-9
            expected = short.rig.lidar.sweep(index, start_s, sweep.stamp_ns)
            np.testing.assert_array_equal(sweep.xyz, expected.xyz)
            np.testing.assert_array_equal(sweep.ring, expected.ring)
            assert np.abs(sweep.offset_ns - expected.offset_ns).max() <= 2  # float32 seconds in the file
    finally:
        recording.close()


def test_an_existing_bag_is_never_overwritten(tmp_path):
    path = tmp_path / "drive.bag"
    path.write_text("mine")
    with pytest.raises(FileExistsError, match="there already"):
        BagWriter(path, lidar_topic="/l", lidar_frame="l", camera_topic="/c", camera_frame="c")
    assert path.read_text() == "mine"


def test_an_empty_sweep_is_a_valid_message(tmp_path):
    path = tmp_path / "empty.bag"
    nothing = Sweep(
        5, np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros(0, np.uint16), np.zeros(0, np.int64)
    )
    with BagWriter(path, lidar_topic="/l", lidar_frame="l", camera_topic="/c", camera_frame="c") as bag:
        bag.write_sweep(nothing, 6)
        bag.write_frame(Frame(7, b"\xff\xd8\xff\xd9", "image/jpeg", 1, 1), 8)
    [(at, cloud)] = list(messages(path, "/l"))
    assert (at, cloud.width, len(cloud.data)) == (6, 0, 0)
    [(_, frame)] = list(messages(path, "/c"))
    assert frame.data.tobytes() == b"\xff\xd8\xff\xd9"
