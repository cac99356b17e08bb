"""Bags as rosbags sees them, independently of our own readers."""

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from workers.readers.recording import Sweep
from workers.simulation.bag_writer import POINT, BagWriter, CameraChannel, Picture
from workers.simulation.rig import START_NS

CAMERA = CameraChannel("c", "c_optical")


def messages(path, topic):
    with AnyReader([path]) as bag:
        chosen = [connection for connection in bag.connections if connection.topic == topic]
        for connection, received_ns, raw in bag.messages(chosen):
            yield received_ns, bag.deserialize(raw, connection.msgtype)


def stamp_ns(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def test_rosbags_reads_every_sweep(short):
    clouds = list(messages(short.files.recording, "/velodyne_points"))
    assert len(clouds) == short.files.sweeps == 50
    received = [at for at, _ in clouds]
    assert received == sorted(received)
    for index, (at, cloud) in enumerate(clouds):
        expected = short.rig.lidar.sweep(index, (stamp_ns(cloud) - START_NS) * 1e-9, 0)
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


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_an_empty_sweep_is_a_valid_message(tmp_path, kind):
    path = tmp_path / ("empty.bag" if kind == "bag" else "empty")
    nothing = Sweep(
        5, np.zeros((0, 3), np.float32), np.zeros(0, np.float32), np.zeros(0, np.uint16), np.zeros(0, np.int64)
    )
    with BagWriter(path, kind, "l", [CAMERA]) as bag:
        bag.write_sweep(nothing, 6)
        bag.write_picture("c", Picture(7, np.full((4, 4, 3), 200, np.uint8)), 8)
    [(at, cloud)] = list(messages(path, "/velodyne_points"))
    assert (at, cloud.width, len(cloud.data)) == (6, 0, 0)
    [(_, frame)] = list(messages(path, "/camera/c/image/compressed"))
    assert stamp_ns(frame) == 7
    assert np.abs(cv2.imdecode(frame.data, cv2.IMREAD_COLOR).astype(int) - 200).max() < 4
