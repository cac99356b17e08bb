"""Bags as rosbags sees them, independently of our own readers."""

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from workers.readers.recording import Sweep
from workers.simulation.bag_writer import BagWriter, CameraChannel, Picture

CAMERA = CameraChannel("c", "c_optical")


def messages(path, topic):
    with AnyReader([path]) as bag:
        chosen = [connection for connection in bag.connections if connection.topic == topic]
        for connection, received_ns, raw in bag.messages(chosen):
            yield received_ns, bag.deserialize(raw, connection.msgtype)


def stamp_ns(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


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
