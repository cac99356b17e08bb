import numpy as np
import pytest
from making_packets import captured, packets, write_pcap
from making_recordings import (
    CLOUD,
    COMPRESSED,
    PERIOD_NS,
    START_NS,
    cloud,
    clouds,
    compressed,
    images,
    interleaved,
    jpeg_claiming,
    png,
    scattered,
    scene,
    write_bag,
)
from making_ros2 import as_cdr, rig, write_mcap

from apexcal.documents.recordings import ImageSize
from workers.readers import progress
from workers.readers.normalised import sensor_writers
from workers.readers.normalised.manifest import RecordingManifest
from workers.readers.normalised.normalise import normalise
from workers.readers.normalised.sensor_files import FrameFile, SweepFile
from workers.readers.recording import ReadError


def frames_of(out, sensor):
    with FrameFile(out / sensor.file) as file:
        assert len(file) == sensor.count
        return list(file.rows()), [file.data(index) for index in range(len(file))]


def test_a_bag_becomes_one_file_per_sensor(tmp_path):
    path = write_bag(tmp_path / "a.bag", interleaved(clouds(5), images(5)))
    seen = []
    out = tmp_path / "out"
    manifest = normalise(path, out, cameras=["front"], on_progress=seen.append)
    assert (seen[-1].done, seen[-1].total, seen[-1].share) == (10, 10, 1.0)
    assert RecordingManifest.model_validate_json(manifest.model_dump_json()) == manifest
    lidar, camera = manifest.sensors
    assert (manifest.format, manifest.warnings) == ("rosbag1", [])
    assert (lidar.name, lidar.topic, lidar.frame_id, lidar.count) == ("lidar", "/points", "velodyne", 5)
    assert (lidar.rate_hz, lidar.ring_count, lidar.time_source) == (10.0, 16, "per_point")
    assert (lidar.first_ns, lidar.last_ns) == (START_NS, START_NS + 4 * PERIOD_NS)
    assert (lidar.stamp_convention, lidar.points) == ("start", 1440)
    assert (lidar.partial, lidar.empty, lidar.overlap_s) == ([], 0, None)
    times = {"first_ns": START_NS, "last_ns": START_NS + 412_000_000, "seconds": 0.412, "together_s": 0.388}
    assert manifest.facts() == {"format": "rosbag1", "omissions": []} | times
    assert (camera.overlap_s, camera.overlap_share, camera.sizes) == (
        0.388,
        0.97,
        [ImageSize(width=8, height=6, count=5)],
    )
    assert (camera.name, camera.topic, camera.width, camera.height) == ("front", "/camera/compressed", 8, 6)
    assert camera.transcoded is False and camera.first_ns == START_NS + 12_000_000
    table, frames = frames_of(out, camera)
    assert frames == [png(8, 6, i) for i in range(5)]
    assert {(row["media_type"], row["width"]) for row in table} == {("image/png", 8)}
    with SweepFile(out / lidar.file) as file:
        assert file.stamps_ns.tolist() == [START_NS + i * PERIOD_NS for i in range(5)]
        np.testing.assert_array_equal(file.sweep(3).ring, np.sort(scene()["ring"]))


def test_stamps_out_of_order_keep_table_and_bytes_together(tmp_path):
    stamps = [3, 1, 2, 2]
    at = [START_NS + stamp * PERIOD_NS for stamp in stamps]
    cam = [("/cam", COMPRESSED, START_NS + i, compressed(s, png(8, 6, i))) for i, s in enumerate(at)]
    lid = [("/points", CLOUD, START_NS + i, cloud(s, scene(columns=10 + i))) for i, s in enumerate(at)]
    manifest = normalise(write_bag(tmp_path / "a.bag", interleaved(lid, cam)), tmp_path / "out", cameras=["cam"])
    table, frames = frames_of(tmp_path / "out", manifest.sensors[1])
    assert [(s - START_NS) // PERIOD_NS for s in (row["stamp_ns"] for row in table)] == [1, 2, 2, 3]
    assert frames == [png(8, 6, i) for i in (1, 2, 3, 0)]
    with SweepFile(tmp_path / "out" / "lidar.sweeps") as file:
        assert [len(s.xyz) for s in file.sweeps()] == [16 * n for n in (11, 12, 13, 10)]
    assert sum("run backwards" in w for w in manifest.warnings) == 2


@pytest.mark.parametrize(
    ("messages", "code"),
    [
        (list(images(3)), "no_lidar_topic"),
        (list(clouds(3)), "no_camera_topic"),
        (interleaved(clouds(3), images(3, data=jpeg_claiming(60000, 60000))), "image_too_large"),
        (interleaved(clouds(3, scattered(), fields=dict.fromkeys("xyz", "f4")), images(3)), "rings_not_separable"),
    ],
)
def test_after_an_error_nothing_is_left(tmp_path, messages, code):
    path = write_bag(tmp_path / "a.bag", messages)
    with pytest.raises(ReadError) as caught:
        normalise(path, tmp_path / "out", cameras=["front"])
    assert caught.value.code == code
    assert list((tmp_path / "out").iterdir()) == []


def test_a_frame_of_too_many_bytes_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(sensor_writers, "MAX_FRAME_BYTES", len(png(8, 6, 0)) - 1)
    path = write_bag(tmp_path / "a.bag", interleaved(clouds(3), images(3)))
    with pytest.raises(ReadError, match="are the most") as caught:
        normalise(path, tmp_path / "out", cameras=["front"])
    assert caught.value.code == "image_too_large"


def test_sensors_of_different_times_and_frames_of_different_sizes_are_said(tmp_path):
    late = START_NS + 3600 * 10**9
    cam = [("/cam", COMPRESSED, late + i, compressed(late + i, png(8 + i // 2, 6))) for i in range(3)]
    manifest = normalise(write_bag(tmp_path / "a.bag", interleaved(clouds(3), cam)), tmp_path / "out")
    assert any("share no time" in w for w in manifest.warnings)
    assert manifest.sensors[1].overlap_s == 0.0 and manifest.facts()["together_s"] == 0.0
    (omission,) = manifest.omissions
    assert (omission.code, omission.count, omission.total) == ("image_size_differs", 1, 3)
    assert "9 x 6" in omission.example and manifest.sensors[1].count == 2


def test_the_intrinsics_that_a_recording_states_are_kept_and_held_against_its_images(tmp_path):
    path = write_mcap(tmp_path / "a.mcap", as_cdr(rig(3)))
    manifest = normalise(path, tmp_path / "out", cameras=["front"])
    stated = manifest.sensors[1].camera_info
    assert (stated.model, stated.width, stated.K[0]) == ("brown_conrady", 1920, 1176.9)
    assert any("camera info is for 1920 x 1208 pixels, its frames have 8 x 6" in said for said in manifest.warnings)


def test_of_a_capture_the_bytes_tell_how_far_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr(progress, "_EVERY_S", 0.0)
    seen = []
    path = write_pcap(tmp_path / "a.pcap", captured(packets("vlp16", 4.2)))
    manifest = normalise(path, tmp_path / "out", cameras=[], on_progress=seen.append)
    shares = [moment.share for moment in seen]
    assert seen[0].total is None and 0.0 < shares[0] < 0.6 and shares == sorted(shares) and shares[-1] == 1.0
    assert manifest.sensors[0].count == 5 and manifest.sensors[0].partial == ["last"]
