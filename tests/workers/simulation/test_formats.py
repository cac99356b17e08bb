"""Each format goes out and comes back in through our own readers: the same points, stamps and pictures."""

import json
from functools import cache
from typing import get_args

import cv2
import numpy as np
import pytest

from apexcal.documents.simulation import Format, SimulationOptions
from workers.readers.detect import open_recording
from workers.simulation.background import paint_background
from workers.simulation.render import Renderer
from workers.simulation.rig import SimulatedRig
from workers.simulation.simulate import simulate

FORMATS = get_args(Format)


def settings(kind):
    return SimulationOptions(
        seconds=1.0, seed=6, cameras="front,left", camera_hz=6.0, clock_offset_ms=30.0, sector_deg=55.0, format=kind
    )


@pytest.fixture(autouse=True)
def painted_once(monkeypatch):
    """The still background of each camera is the same in every format; painting it is half of the time."""
    monkeypatch.setattr("workers.simulation.simulate.paint_background", background)


def background(camera, scene, seed):
    return _background(camera.T_camera_lidar.to_frame, seed)


@cache
def _background(frame, seed):
    rig = SimulatedRig(settings("bag"))
    camera = next(mounted.camera for mounted in rig.cameras if mounted.camera.T_camera_lidar.to_frame == frame)
    return paint_background(camera, rig.scene, seed)


@cache
def first_picture():
    """What the first frame of the front camera shows, before it is encoded."""
    rig = SimulatedRig(settings("bag"))
    renderer = Renderer(rig.camera, rig.scene, background(rig.camera, rig.scene, rig.options.seed))
    times_s = (rig.cameras[0].times_ns - 1_780_000_000_000_000_000) * 1e-9
    return renderer.frame(rig.walk.poses(times_s), 0)


def in_order(sweep):
    return np.lexsort((sweep.offset_ns, sweep.ring))


def check_sweep(sweep, expected):
    assert len(sweep.xyz) == len(expected.xyz)
    got, want = in_order(sweep), in_order(expected)
    np.testing.assert_array_equal(sweep.ring[got], expected.ring[want])
    at_ns = sweep.stamp_ns + sweep.offset_ns[got] - expected.stamp_ns - expected.offset_ns[want]
    np.testing.assert_array_equal(sweep.xyz[got], expected.xyz[want])
    assert np.abs(at_ns).max() <= 4  # float32 seconds in the file
    np.testing.assert_array_equal(sweep.intensity[got], expected.intensity[want])


@pytest.mark.parametrize("kind", FORMATS)
def test_what_is_written_is_read_back(kind, tmp_path):
    written = simulate(settings(kind), tmp_path)
    rig = SimulatedRig(settings(kind))
    recording = open_recording(written.recording)
    try:
        sensors = {sensor.name: sensor for sensor in recording.sensors}
        described = json.loads(written.rig.read_text())
        lidar = sensors[described["lidar"]["topic"]]
        sweeps = list(recording.sweeps(lidar))
        expected = list(rig.sweeps())
        assert len(sweeps) == len(expected)
        assert {sweep.time_source for sweep in sweeps} == {"per_point"}
        for sweep, want in zip(sweeps, expected, strict=True):
            check_sweep(sweep, want)
        facts = recording.lidar_facts(lidar)
        assert (facts.ring_count, facts.stamp_convention) == (16, "start")
        assert facts.sweep_ns == pytest.approx(1e8, rel=0.01)
        for camera, mounted in zip(described["cameras"], rig.cameras, strict=True):
            frames = list(recording.frames(sensors[camera["topic"]]))
            assert [frame.stamp_ns for frame in frames] == mounted.stamps_ns.tolist()
            assert {(frame.width, frame.height) for frame in frames} == {(960, 600)}
        front = next(recording.frames(sensors[described["cameras"][0]["topic"]]))
        shown = cv2.imdecode(np.frombuffer(front.data, np.uint8), cv2.IMREAD_COLOR)
        assert np.abs(shown.astype(float) - first_picture()).mean() < 4.0
    finally:
        recording.close()
