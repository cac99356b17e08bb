"""Each format goes out and comes back in through our own readers: the same points, stamps and pictures."""

import json
from functools import cache

import cv2
import numpy as np
import pytest

from workers.readers.detect import open_recording
from workers.readers.recording import ReadOptions, Sweep
from workers.simulation.background import paint_background
from workers.simulation.render import Renderer
from workers.simulation.rig import Rig
from workers.simulation.settings import FORMATS, Settings, parse_cameras
from workers.simulation.simulate import simulate

PACKETS = ("pcap", "pcapng", "video")
HUNDREDTH_RAD = np.radians(0.0125)  # packets hold azimuths in hundredths of a degree, decoders round again


def settings(kind):
    # A sensor that looks all round where packets show it: their sweeps follow each other without a gap.
    return Settings(
        seconds=1.0,
        seed=6,
        cameras=parse_cameras("front,left"),
        camera_hz=6.0,
        clock_offset_ms=30.0,
        sector_deg=180.0 if kind == "pcapng" else 55.0,
        format=kind,
    )


@pytest.fixture(autouse=True)
def painted_once(monkeypatch):
    """The still background of each camera is the same in every format; painting it is half of the time."""
    monkeypatch.setattr("workers.simulation.simulate.paint_background", background)


def background(camera, scene, seed):
    return _background(camera.T_camera_lidar.to_frame, seed)


@cache
def _background(frame, seed):
    rig = Rig(settings("bag"))
    camera = next(mounted.camera for mounted in rig.cameras if mounted.camera.T_camera_lidar.to_frame == frame)
    return paint_background(camera, rig.scene, seed)


@cache
def first_picture():
    """What the first frame of the front camera shows, before it is encoded."""
    rig = Rig(settings("bag"))
    renderer = Renderer(rig.camera, rig.scene, background(rig.camera, rig.scene, rig.settings.seed))
    times_s = (rig.cameras[0].times_ns - 1_780_000_000_000_000_000) * 1e-9
    return renderer.frame(rig.walk.poses(times_s), 0)


def joined(sweeps):
    """All sweeps as one, for a sensor that looks all round: a reader cuts beside the writer's seam."""
    stamp_ns = sweeps[0].stamp_ns
    return Sweep(
        stamp_ns,
        np.concatenate([sweep.xyz for sweep in sweeps]),
        np.concatenate([sweep.intensity for sweep in sweeps]),
        np.concatenate([sweep.ring for sweep in sweeps]),
        np.concatenate([sweep.offset_ns + (sweep.stamp_ns - stamp_ns) for sweep in sweeps]),
        sweeps[0].time_source,
    )


def in_order(sweep):
    return np.lexsort((sweep.offset_ns, sweep.ring))


def check_sweep(kind, sweep, expected):
    assert len(sweep.xyz) == len(expected.xyz)
    got, want = in_order(sweep), in_order(expected)
    np.testing.assert_array_equal(sweep.ring[got], expected.ring[want])
    metres = np.linalg.norm(expected.xyz[want], axis=1)
    off = np.linalg.norm(sweep.xyz[got].astype(float) - expected.xyz[want], axis=1)
    at_ns = sweep.stamp_ns + sweep.offset_ns[got] - expected.stamp_ns - expected.offset_ns[want]
    if kind in PACKETS:
        assert (off < 0.0015 + HUNDREDTH_RAD * metres).all()
        assert np.ptp(at_ns) < 15_000
        assert abs(np.median(at_ns)) < 300_000  # the host's clock, which gets them a little later
        assert np.abs(sweep.intensity[got] - expected.intensity[want]).max() <= 0.5
    else:
        np.testing.assert_array_equal(sweep.xyz[got], expected.xyz[want])
        assert np.abs(at_ns).max() <= 4  # float32 seconds in the file
        np.testing.assert_array_equal(sweep.intensity[got], expected.intensity[want])


@pytest.mark.parametrize("kind", [kind for kind in FORMATS if kind != "kitti"])
def test_what_is_written_is_read_back(kind, tmp_path):
    written = simulate(settings(kind), tmp_path)
    rig = Rig(settings(kind))
    recording = open_recording(written.recording)
    try:
        sensors = {sensor.name: sensor for sensor in recording.sensors}
        described = json.loads(written.rig.read_text())
        lidar = sensors[described["lidar"]["topic"]]
        sweeps = list(recording.sweeps(lidar))
        expected = list(rig.sweeps())
        assert len(sweeps) == len(expected)
        assert {sweep.time_source for sweep in sweeps} == {"per_point"}
        if rig.settings.sector_deg == 180.0:
            for sweep, want in zip(sweeps, expected, strict=True):
                assert abs(len(sweep.xyz) - len(want.xyz)) <= 16  # a column
            sweeps, expected = [joined(sweeps)], [joined(expected)]
        for sweep, want in zip(sweeps, expected, strict=True):
            check_sweep(kind, sweep, want)
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


def test_kitti_s_layout_comes_back_with_its_rings_computed(tmp_path):
    """KITTI's clouds have no rings and no times of points, and its image folders have numbers for names."""
    written = simulate(settings("kitti"), tmp_path)
    rig = Rig(settings("kitti"))
    recording = open_recording(written.recording, ReadOptions(rings=16))
    try:
        sensors = {sensor.name: sensor for sensor in recording.sensors}
        assert sum(sensor.kind == "camera" for sensor in sensors.values()) == 2
        described = json.loads(written.rig.read_text())
        sweeps = list(recording.sweeps(sensors[described["lidar"]["topic"]]))
        assert len(sweeps) == written.sweeps
        for index, sweep in enumerate(sweeps):
            expected = rig.sweep(index)
            assert len(sweep.xyz) == len(expected.xyz)
            order = [np.lexsort(np.round(cloud.xyz.astype(float), 4).T) for cloud in (sweep, expected)]
            np.testing.assert_array_equal(sweep.xyz[order[0]], expected.xyz[order[1]])
            np.testing.assert_array_equal(sweep.ring[order[0]], expected.ring[order[1]])
        front = sensors[described["cameras"][0]["topic"]]
        stamps = [frame.stamp_ns for frame in recording.frames(front)]
        assert stamps == rig.frame_stamps_ns.tolist()
    finally:
        recording.close()


def test_a_recording_that_is_there_is_never_written_over(tmp_path):
    for kind in FORMATS:
        out = tmp_path / kind
        out.mkdir()
        for name in ("recording", "recording.bag", "recording.tar", "recording.zip"):
            (out / name).write_text("mine")
        with pytest.raises(FileExistsError, match="there already"):
            simulate(settings(kind), out)
        assert (out / "recording").read_text() == "mine"


def test_packets_of_other_sensors_are_refused():
    with pytest.raises(ValueError, match="only the packets of a vlp16"):
        Settings(format="pcap", sensor="hdl32")
    with pytest.raises(ValueError, match="only the packets of a vlp16"):
        Settings(format="video", rings=32)
