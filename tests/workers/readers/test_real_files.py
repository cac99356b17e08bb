"""Every real recording there is, through the whole ingestion."""

import numpy as np
import pytest
from pypcd4 import PointCloud

from apexcal.documents.readings import ReadOptions
from tests.support.places import BOARD, DATA
from workers.readers.clouds.rings import learn_missing_rings
from workers.readers.inspection import inspect_recording
from workers.readers.limited import ingest_limited
from workers.readers.normalised.sensor_files import FrameFile, SweepFile
from workers.readers.recording import ReadError


def ingested(path, out, **request):
    if not path.exists():
        pytest.skip(f"real data is not here: ../shared/data/{path.relative_to(DATA)}")
    manifest = ingest_limited(path, out, request)
    manifest.model_dump_json()
    with SweepFile(out / "lidar.sweeps") as file:
        return manifest, list(file.sweeps())


def by_ring(xyz, ring):
    """Points in an order that does not depend on the file's: by ring, then by azimuth."""
    return xyz[np.lexsort((np.arctan2(xyz[:, 1], xyz[:, 0]), ring))]


def test_the_capture(tmp_path):
    manifest, sweeps = ingested(DATA / "vlp16-pcap" / "sample_velodyne_vlp16_gps.pcap", tmp_path / "out", cameras=[])
    # Published: 18790, 18701, 18678, 17317, each overlapping the next by up to a packet (4.8 degrees); cut at the
    # seam, up to 227 points go to the next sweep, and the last one begins earlier by all of them.
    assert [len(sweep.xyz) for sweep in sweeps] == [18563, 18560, 18535, 17828] and manifest.warnings == []
    (lidar,) = manifest.sensors
    assert (lidar.ring_count, lidar.time_source) == (16, "per_point")
    assert any("-368.1 ms" in note for note in lidar.notes)
    assert all(abs(step - 100_200_000) < 200_000 for step in np.diff([sweep.stamp_ns for sweep in sweeps]))


def test_the_ros_2_bag_agrees_with_the_published_cloud(tmp_path):
    folder = DATA / "vlp16-ros2"
    manifest, sweeps = ingested(folder / "1673400471837873222", tmp_path / "out", cameras=[])
    assert (manifest.sensors[0].count, manifest.sensors[0].ring_count) == (4, 16)
    assert [len(sweep.xyz) for sweep in sweeps] == [14547, 14513, 14542, 14576]  # of two returns the strongest
    published = PointCloud.from_path(folder / "1673400472138016708.pcd").pc_data
    stamps = np.array([sweep.stamp_ns for sweep in sweeps])
    sweep = sweeps[int(np.argmin(np.abs(stamps - 1673400472138016708)))]
    # The published cloud leaves out the heights of the lasers (at most 11.2 mm; the maker's manual states them, ROS
    # drivers put them in), and does not turn the azimuth on in the last two blocks of each packet (0.33 degrees).
    height = np.array([11.2, 9.7, 8.1, 6.6, 5.1, 3.7, 2.2, 0.7]) / 1000
    points = np.stack([published["x"], published["y"], published["z"]], 1).astype(np.float64)
    points[:, 2] += np.r_[height, -height[::-1]][published["channel"]]
    points = points[published["time_stamp"] < 20 * 55_296]
    nearest = np.array([np.linalg.norm(sweep.xyz - point, axis=1).min() for point in points[::25]])
    assert np.median(nearest) < 0.001 and np.mean(nearest < 0.005) > 0.96
    assert 0 not in set(sweep.ring.tolist()) and any("dual return" in note for note in manifest.sensors[0].notes)


def test_the_bag_and_the_folder_of_the_same_poses_give_the_same_clouds(tmp_path):
    request = {"cameras": ["front"], "options": {"point_times": "stamp_only"}}
    bag, from_bag = ingested(BOARD / "recording.bag", tmp_path / "bag", **request)
    assert [(s.count, s.name) for s in bag.sensors] == [(20, "lidar"), (20, "front")] and bag.warnings == []
    folder, from_folder = ingested(BOARD / "frames", tmp_path / "folder", **request)
    assert [s.count for s in folder.sensors] == [4, 4]
    for twin, sweep in zip(from_bag, from_folder, strict=False):  # poses 1, 3, 5, 7 of 1, 3, ... 39
        assert len(sweep.xyz) == len(twin.xyz)
        np.testing.assert_allclose(by_ring(sweep.xyz, sweep.ring), by_ring(twin.xyz, twin.ring), atol=1e-4)
        np.testing.assert_array_equal(np.sort(sweep.ring), np.sort(twin.ring))
    with FrameFile(tmp_path / "folder" / folder.sensors[1].file) as frames:
        assert {row["media_type"] for row in frames.rows()} == {"image/png"}
    assert (folder.sensors[1].width, folder.sensors[1].height) == (1920, 1208)


def test_the_bag_s_sweeps_and_frames(tmp_path):
    manifest, sweeps = ingested(BOARD / "recording.bag", tmp_path / "out", cameras=["front"])
    (lidar, camera), original = manifest.sensors, (BOARD / "recording.bag").read_bytes()
    assert (camera.width, camera.height, camera.transcoded) == (1920, 1208, False)
    with FrameFile(tmp_path / "out" / camera.file) as frames:
        assert len(frames) == 20 and all(frames.data(index) in original for index in range(20))
    assert lidar.time_source == "derived_from_azimuth"
    without = learn_missing_rings([sweep.xyz for sweep in sweeps[:5]], "lidar")
    assert without.count == 16 and "VLP-16" in without.note
    for sweep in sweeps:
        elevation = np.degrees(np.arctan2(sweep.xyz[:, 2], np.hypot(sweep.xyz[:, 0], sweep.xyz[:, 1])))
        medians = [np.median(elevation[sweep.ring == ring]) for ring in range(16)]
        np.testing.assert_allclose(medians, np.arange(-15, 16, 2), atol=0.3)
        np.testing.assert_array_equal(without.number(sweep.xyz), sweep.ring)


def test_one_road_frame(tmp_path):
    manifest, (sweep,) = ingested(DATA / "road-lane-markers", tmp_path / "out", cameras=["center"])
    lidar, camera = manifest.sensors
    assert len(sweep.xyz) == 85_546 and lidar.ring_count == 64
    assert (camera.count, camera.width, camera.height) == (1, 1920, 1200)
    rings = learn_missing_rings([sweep.xyz[::7]], "lidar")
    assert rings.count == 64
    np.testing.assert_array_equal(rings.number(sweep.xyz), sweep.ring)


def test_images_alone_are_no_recording(tmp_path):
    with pytest.raises(ReadError) as caught:
        ingested(DATA / "chessboard", tmp_path / "out", cameras=["left"])
    assert caught.value.code in ("no_lidar_topic", "files_without_times") and "left" in caught.value.message


@pytest.mark.parametrize(
    ("name", "lidar", "camera", "size"),
    [
        ("vlp16-diamond-board/recording.bag", ("velodyne", 20), ("camera_image_color", "camera", 20), (1920, 1208)),
        ("os1-64-board", ("lidar", 12), ("images", "camera_images_optical", 12), (1920, 1200)),
        # Beside its clouds lies a table of corners.
        ("pandar40-tripod", ("lidar", 8), ("images", "camera_images_optical", 8), (1920, 1080)),
    ],
)
def test_each_recording_with_images_proposes_a_rig(name, lidar, camera, size):
    path = DATA / name
    if not path.exists():
        pytest.skip(f"real data is not here: ../shared/data/{name}")
    inspection = inspect_recording(path, options=ReadOptions(point_times="stamp_only"))
    rig, (question,) = inspection.proposal.rig, inspection.proposal.questions
    assert (rig.lidar.frame, inspection.sensors[0].count) == lidar
    assert (rig.cameras[0].name, rig.cameras[0].frame, inspection.sensors[1].count) == camera
    assert rig.cameras[0].image_size == size and (question.sensor, question.asks) == (camera[0], "looks")


def test_a_table_of_corners_is_no_second_lidar_of_dense_clouds():
    path = DATA / "infrared-level-board"
    if not path.exists():
        pytest.skip("real data is not here: ../shared/data/infrared-level-board")
    inspection = inspect_recording(path, options=ReadOptions(point_times="stamp_only"))
    assert [(sensor.kind, sensor.count) for sensor in inspection.sensors] == [("lidar", 4), ("camera", 4)]
