"""What the thermal camera records: counts of 16 bits with the stated noise, and a board of the drawn contrast."""

import numpy as np
import pytest

from apexcal.documents.readings import ReadOptions
from apexcal.documents.simulation import SimulationOptions
from workers.readers.detect import open_recording
from workers.readers.images.deep_images import depth_of
from workers.simulation.rig import START_NS, SimulatedRig
from workers.simulation.simulate import simulate
from workers.simulation.thermal import ThermalCamera

COUNTS_A_KELVIN = 25.0
AIR = 290.0 * COUNTS_A_KELVIN


def test_a_recording_holds_temperatures(tmp_path):
    options = SimulationOptions(seconds=1.0, seed=6, camera_hz=10.0, images="thermal", walk="yard", format="mcap")
    files = simulate(options, tmp_path)
    opened = open_recording(files.recording, ReadOptions())
    try:
        (camera,) = (sensor for sensor in opened.sensors if sensor.kind == "camera")
        frames = [depth_of(frame.data) for frame in opened.frames(camera)]
    finally:
        opened.close()
    mounted = SimulatedRig(options).cameras[0]
    poses = SimulatedRig(options).walk.poses((mounted.times_ns - START_NS).astype(np.float64) * 1e-9)
    assert len(frames) == len(mounted.times_ns) == 10
    assert all(frame.dtype == np.uint16 and frame.shape == (600, 960) for frame in frames)
    # Below the tip by a third of the way to the bottom corner is neither a hand nor an edge.
    inner = poses.apex + 0.33 * (poses.board_m[0] * poses.edge_left + poses.board_m[1] * poses.edge_right)
    places = np.round(mounted.camera.project(inner)).astype(int)
    levels = [frame[v - 1 : v + 2, u - 1 : u + 2].mean() for frame, (u, v) in zip(frames, places, strict=True)]
    assert np.mean(levels) - AIR == pytest.approx(COUNTS_A_KELVIN * ThermalCamera(6).contrast_k, abs=2.0)
    # The walker is elsewhere: what differs is noise, 50 mK in each frame.
    corner = np.diff([frame[400:600, 0:150].astype(float) for frame in frames[:2]], axis=0)
    assert corner.std() / np.sqrt(2.0) == pytest.approx(0.05 * COUNTS_A_KELVIN, rel=0.1)
