"""Bags of ROS 2 and MCAP files read whole, and what must be in them."""

import numpy as np
import pytest
from making_recordings import PERIOD_NS, START_NS, scene

from workers.readers.detect import open_recording
from workers.readers.recording import Frame, ReadError, ReadOptions, Sweep
from workers.readers.ros.rosbag2 import Rosbag2Recording


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


def check_damage(path):
    """Sixteen bytes of the file at a time are made noise: what is damaged is said, and nothing else goes wrong."""
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
