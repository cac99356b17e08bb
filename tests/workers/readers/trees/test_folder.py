import gzip
import shutil
import tarfile
import zipfile
from itertools import islice

import cv2
import numpy as np
import pytest
from making_recordings import CLOUD, DATA, START_NS, cloud, clouds, images, png, png_claiming, scene, write_bag
from making_ros2 import rig, write_ros2
from making_videos import TIMES_MS, number_of, write_video
from pypcd4 import Encoding, PointCloud

from workers.readers.detect import open_recording
from workers.readers.normalised.normalise import normalise
from workers.readers.recording import ReadError, ReadOptions, Sweep
from workers.readers.ros.rosbag1 import Rosbag1Recording
from workers.readers.trees.folder import FolderRecording

FRAMES = DATA / "vlp16-diamond-board" / "frames"
LANES = DATA / "road-lane-markers"
FIELDS = {"x": np.float32, "y": np.float32, "z": np.float32, "intensity": np.float32, "ring": np.uint16}


def write_pcd(path, fields=FIELDS, encoding=Encoding.BINARY):
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = [scene()[name].astype(form) for name, form in fields.items()]
    PointCloud.from_points(columns, list(fields), list(fields.values())).save(path, encoding)


def write_png(path, grey=0):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png(8, 6, grey))


def xyz():
    return np.stack([scene()[axis] for axis in "xyz"], 1).astype(np.float32)


def names(recording):
    return [(sensor.kind, sensor.name, sensor.count) for sensor in recording.sensors]


def zipped(root, path, packing=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", packing) as archive:
        for file in sorted(root.rglob("*")):
            archive.write(file, file.relative_to(root.parent))
    return path


def test_a_subfolder_per_sensor_merged_by_time(tmp_path):
    for i in range(3):
        write_pcd(tmp_path / "velodyne" / f"{1_700_000_000_000_000_000 + i * 100_000_000}.pcd")
        write_png(tmp_path / "front" / f"{1_700_000_000_012 + i * 100}.png", i)
        write_png(tmp_path / "rear" / f"{1_700_000_000_050 + i * 100}.png", i)
    recording = FolderRecording(tmp_path, ReadOptions())
    assert names(recording) == [("camera", "front", 3), ("camera", "rear", 3), ("lidar", "velodyne", 3)]
    front, _, lidar = recording.sensors
    assert (front.notes["width"], front.notes["height"]) == ("8", "6")
    assert lidar.notes["fields"] == "x y z intensity ring"
    messages = list(recording.messages(recording.sensors))
    assert [sensor.name for sensor, _ in messages] == ["velodyne", "front", "rear"] * 3
    assert recording.warnings == []
    facts = recording.lidar_facts(lidar)
    assert (facts.time_source, facts.sweep_ns) == ("derived_from_azimuth", 100_000_000)


def test_several_sensors_in_one_folder_by_their_names(tmp_path):
    for i in range(2):
        write_pcd(tmp_path / f"cloud_{i}.pcd")
        write_png(tmp_path / f"left_{i}.png")
        write_png(tmp_path / f"right_{i}.png")
    recording = FolderRecording(tmp_path, ReadOptions())
    assert [s.name for s in recording.sensors] == ["left", "right", "clouds"]


def test_clouds_and_images_in_one_subfolder_have_names_of_their_own(tmp_path):
    write_pcd(tmp_path / "walk" / "frames" / "1.pcd")
    write_png(tmp_path / "walk" / "frames" / "1.png")
    assert [s.name for s in FolderRecording(tmp_path, ReadOptions()).sensors] == ["images", "clouds"]


def test_files_beside_a_folder_that_has_their_name_are_another_sensor(tmp_path):
    for place in ("", "clouds", "walk", "walk/data"):
        for number in (1, 2):
            write_pcd(tmp_path / "drive" / place / f"{number}.pcd")
    recording = FolderRecording(tmp_path / "drive", ReadOptions())
    assert names(recording) == [("lidar", name, 2) for name in ("clouds", "clouds_2", "walk", "walk_2")]
    assert [len(list(recording.sweeps(lidar))) for lidar in recording.sensors] == [2, 2, 2, 2]


def test_numbered_files_are_simultaneous_and_each_sweep_one_moment(tmp_path):
    for i in (2, 10, 9):
        write_pcd(tmp_path / f"pose{i}.pcd")
        write_png(tmp_path / f"pose{i}.png", i)
    recording = FolderRecording(tmp_path, ReadOptions())
    camera, lidar = recording.sensors
    sweeps, frames = list(recording.sweeps(lidar)), list(recording.frames(camera))
    assert [s.stamp_ns for s in sweeps] == [f.stamp_ns for f in frames]
    assert [f.data for f in frames] == [png(8, 6, i) for i in (2, 9, 10)]
    assert {s.time_source for s in sweeps} == {"stamp_only"} and not sweeps[0].offset_ns.any()
    assert "made up" in recording.warnings[0]


def test_a_table_of_stamps(tmp_path):
    write_pcd(tmp_path / "b.pcd")
    write_pcd(tmp_path / "a.pcd")
    (tmp_path / "timestamps.csv").write_text("file,stamp_ns\na.pcd,2000\nb.pcd,1000\n")
    recording = FolderRecording(tmp_path, ReadOptions())
    assert [s.stamp_ns for s in recording.sweeps(recording.sensors[0])] == [1000, 2000]


def mixed(root):
    """A bag with a LiDAR and a camera, a video with its table, and two folders of images: one with a table."""
    root.mkdir()
    write_bag(root / "walk.bag", [*clouds(3), *images(3)])
    write_video(root / "rear.mp4")
    rows = [f"{i},{START_NS + ms * 1_000_000}" for i, ms in enumerate(TIMES_MS)]
    (root / "rear.csv").write_text("frame,stamp_ns\n" + "\n".join(rows))
    for i in range(2):
        write_png(root / "images" / "left" / f"{START_NS + i * 50_000_000}.png", i)
        write_png(root / "images" / "right" / f"{i}.png", i)
    (root / "images" / "right.csv").write_text(f"file,stamp_ns\nright/0.png,{START_NS}\nright/1.png,{START_NS + 9}\n")
    (root / "notes.txt").write_text("windy")
    return root


@pytest.mark.parametrize("kind", ["folder", "zip", "zip-stored", "tar", "tar.gz"])
def test_a_bag_a_video_and_folders_of_images_are_one_recording(tmp_path, kind):
    root = mixed(tmp_path / "walk")
    path = root
    if kind.startswith("zip"):
        path = zipped(root, tmp_path / "walk.zip", zipfile.ZIP_STORED if "stored" in kind else zipfile.ZIP_DEFLATED)
    elif kind != "folder":
        path = tmp_path / f"walk.{kind}"
        with tarfile.open(path, "w:gz" if kind == "tar.gz" else "w") as archive:
            archive.add(root, "walk")
    recording = open_recording(path)
    assert recording.format == "folder+rosbag1+video"
    expected = [("lidar", "/points", 3), ("camera", "/camera/compressed", 3), ("camera", "rear.mp4", 10)]
    expected += [("camera", "images/left", 2), ("camera", "images/right", 2)]
    assert sorted(names(recording)) == sorted(expected)
    assert len(recording.other_topics) == 1 and "notes.txt" in recording.other_topics[0]
    messages = list(recording.messages(recording.sensors))
    stamps = [item.stamp_ns for _, item in messages]
    assert stamps == sorted(stamps) and len(stamps) == 20
    rear = [item for sensor, item in messages if sensor.name == "rear.mp4"]
    decoded = [cv2.imdecode(np.frombuffer(f.data, np.uint8), cv2.IMREAD_COLOR_RGB) for f in rear]
    assert [number_of(pixels) for pixels in decoded] == list(range(10))
    assert recording.warnings == []
    recording.close()


def test_only_the_chosen_sensors_are_read(tmp_path):
    recording = open_recording(mixed(tmp_path / "walk"))
    chosen = [s for s in recording.sensors if s.name in ("/points", "images/left")]
    assert [s.name for s, _ in recording.messages(chosen)] == [
        "/points",
        "images/left",
        "images/left",
        "/points",
        "/points",
    ]
    recording.close()


def test_equal_topics_of_two_bags_are_told_apart(tmp_path):
    write_bag(tmp_path / "a.bag", clouds(2))
    write_bag(tmp_path / "b.bag", [("/points", CLOUD, START_NS, cloud(START_NS, scene())), *images(1)])
    recording = open_recording(tmp_path)
    assert [s.name for s in recording.sensors] == ["a.bag:/points", "b.bag:/points", "/camera/compressed"]
    assert len(list(recording.sweeps(recording.sensors[0]))) == 2
    recording.close()


@pytest.mark.parametrize("kind", ["zip", "gz"])
def test_a_bag_in_an_archive_is_that_bag(tmp_path, kind):
    bag = write_bag(tmp_path / "walk.bag", [*clouds(2), *images(2)])
    path = tmp_path / f"walk.bag.{kind}"
    if kind == "zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.write(bag, "walk.bag")
    else:
        path.write_bytes(gzip.compress(bag.read_bytes()))
    manifest = normalise(path, tmp_path / "out")
    assert manifest.format == "rosbag1" and [s.count for s in manifest.sensors] == [2, 2]


def test_an_archive_in_an_archive(tmp_path):
    root = tmp_path / "walk"
    root.mkdir()
    write_bag(root / "walk.bag", clouds(2))
    (tmp_path / "outer").mkdir()
    zipped(root, tmp_path / "outer" / "inner.zip")
    with pytest.raises(ReadError, match=r"inner\.zip") as caught:
        open_recording(zipped(tmp_path / "outer", tmp_path / "outer.zip"))
    assert caught.value.code == "folder_empty" and "Unpack" in caught.value.hint


def test_a_video_whose_start_is_in_the_table(tmp_path):
    write_video(tmp_path / "camera.mkv", created=None)
    (tmp_path / "timestamps.csv").write_text("file,stamp_ns\ncamera.mkv,12345678901234\n")
    recording = open_recording(tmp_path)
    (camera,) = recording.sensors
    assert (camera.name, next(recording.frames(camera)).stamp_ns) == ("camera.mkv", 12345678901234)
    recording.close()


@pytest.mark.parametrize("kind", ["folder", "zip"])
def test_a_bag_that_was_split_is_one_recording(tmp_path, kind):
    root = tmp_path / "walk"
    root.mkdir()
    for number in (9, 10):
        stamps = [START_NS + (number * 3 + i) * 100_000_000 for i in range(3)]
        streams = [("/points", CLOUD, stamp, cloud(stamp, scene())) for stamp in stamps]
        write_bag(root / f"walk_{number}.bag", [*streams, *images(2)])
    recording = open_recording(root if kind == "folder" else zipped(root, tmp_path / "walk.zip"))
    assert names(recording) == [("lidar", "/points", 6), ("camera", "/camera/compressed", 4)]
    lidar, camera = recording.sensors
    assert recording.lidar_facts(lidar).ring_count == 16
    stamps = [sweep.stamp_ns for sweep in recording.sweeps(lidar)]
    assert stamps == sorted(stamps) and stamps[0] == START_NS + 2_700_000_000
    assert [sensor.name for sensor, _ in recording.messages([camera])] == [camera.name] * 4
    assert len(list(recording.messages([lidar, camera]))) == 10
    assert "2 files" in recording.warnings[0]
    recording.close()


def test_parts_with_other_rings_are_refused(tmp_path):
    for number, rings in enumerate((16, 32)):
        write_bag(tmp_path / f"walk_{number}.bag", clouds(2, scene(rings)))
    recording = open_recording(tmp_path)
    with pytest.raises(ReadError, match="16, 32"):
        recording.lidar_facts(recording.sensors[0])
    recording.close()


def test_a_picture_beside_a_whole_bag_is_left_out(tmp_path):
    write_bag(tmp_path / "walk.bag", [*clouds(2), *images(2)])
    write_png(tmp_path / "overview.png")
    recording = open_recording(tmp_path)
    assert [s.name for s in recording.sensors] == ["/points", "/camera/compressed"]
    assert "images were left out" in recording.warnings[0]
    recording.close()


def test_made_up_times_beside_real_ones_are_refused(tmp_path):
    write_bag(tmp_path / "walk.bag", clouds(2))
    write_png(tmp_path / "images" / "1.png")
    with pytest.raises(ReadError) as caught:
        open_recording(tmp_path)
    assert caught.value.code == "files_without_times" and "images" in caught.value.message


KITTI_SECONDS = (25.951, 26.054, 26.257)


def kitti(root, clockwise=False):
    """KITTI's raw layout with its folders of date and drive; the LiDAR lost frame 1."""
    drive = root / "2011_09_26" / "2011_09_26_drive_0001_extract"
    lines = {"timestamps.txt": 0.0, "timestamps_start.txt": -0.05, "timestamps_end.txt": 0.051}
    for folder in ("velodyne_points", "image_02", "oxts"):
        (drive / folder / "data").mkdir(parents=True)
        for name, shift in lines.items():
            if name == "timestamps.txt" or folder == "velodyne_points":
                text = "\n".join(f"2011-09-26 13:02:{second + shift:012.9f}" for second in KITTI_SECONDS)
                (drive / folder / name).write_text(text + "\n")
    azimuth = np.arctan2(scene()["y"], scene()["x"])
    order = np.lexsort((-azimuth if clockwise else azimuth, -scene()["ring"]))
    for i in range(3):
        write_png(drive / "image_02" / "data" / f"{i:010d}.png", i)
        (drive / "oxts" / "data" / f"{i:010d}.txt").write_text("49.0 8.4 112.8\n")
        points = np.column_stack([xyz(), np.full(len(xyz()), 0.5 + i)])[order].astype("<f4")
        if i != 1:
            (drive / "velodyne_points" / "data" / f"{i:010d}.bin").write_bytes(points.tobytes())
    return root, order


@pytest.mark.parametrize("clockwise", [False, True])
def test_kittis_raw_layout(tmp_path, clockwise):
    root, order = kitti(tmp_path, clockwise)
    recording = open_recording(root)
    assert names(recording) == [("camera", "image_02", 3), ("lidar", "velodyne_points", 2)]
    camera, lidar = recording.sensors
    start = 1_317_042_120_000_000_000
    stamps = [start + round(second * 1000) * 1_000_000 for second in KITTI_SECONDS]
    assert [f.stamp_ns for f in recording.frames(camera)] == stamps
    facts = recording.lidar_facts(lidar)
    assert (facts.ring_count, facts.sweep_ns, facts.time_source) == (16, 101_000_000, "derived_from_azimuth")
    first, second = recording.sweeps(lidar)
    assert [first.stamp_ns, second.stamp_ns] == [stamps[0], stamps[2]]
    np.testing.assert_array_equal(first.xyz, xyz()[order])
    np.testing.assert_array_equal(first.ring, scene()["ring"][order])
    np.testing.assert_array_equal(second.intensity, np.float32(2.5))
    # Counter-clockwise it looks to the right, at -90 degrees, a quarter of a turn before it looks ahead.
    azimuth = np.arctan2(first.xyz[:, 1], first.xyz[:, 0])
    for side in (np.pi / 2, -np.pi / 2, 0.0):
        expected = side / (2 * np.pi) * 101_000_000 * (-1 if clockwise else 1)
        np.testing.assert_allclose(first.offset_ns[np.abs(azimuth - side) < 0.04], expected, atol=700_000)
    assert first.offset_ns.min() >= -50_000_000 and first.offset_ns.max() <= 51_000_000
    assert any(("clockwise in 101.0 ms" in note) for note in facts.notes)
    recording.close()


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda root: (root / "notes.txt").write_text("nothing"), "folder_empty"),
        (lambda root: (root / "1.png").write_bytes(png_claiming(60000, 60000)), "image_too_large"),
        (lambda root: (root / "1.jpg").write_bytes(b"text"), "image_unsupported"),
        (lambda root: (root / "1.pcd").write_bytes(b"text"), "cloud_malformed"),
        (lambda root: (root / "1.bin").write_bytes(bytes(18)), "cloud_malformed"),
        (lambda root: (root / "1.npy").write_bytes(b"\x93NUMPY\x01\x00"), "cloud_malformed"),
    ],
)
def test_what_cannot_be_used_names_the_file(tmp_path, make, code):
    make(tmp_path)
    with pytest.raises(ReadError) as caught:
        recording = FolderRecording(tmp_path, ReadOptions())
        list(recording.messages(recording.sensors))
    assert caught.value.code == code
    assert code == "folder_empty" or "1." in caught.value.message or "clouds" in caught.value.message


def test_what_was_unpacked_is_removed_when_a_part_cannot_be_read(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "scratch"))
    (tmp_path / "scratch").mkdir()
    root = tmp_path / "walk"
    root.mkdir()
    write_video(root / "camera.mp4")
    bag = write_bag(root / "walk.bag", clouds(2))
    bag.write_bytes(bag.read_bytes()[:-500])
    with pytest.raises(ReadError, match=r"walk\.bag"):
        open_recording(zipped(root, tmp_path / "walk.zip"))
    assert not list((tmp_path / "scratch").iterdir())


def test_the_real_frames_are_the_real_bags(tmp_path):
    if not FRAMES.exists():
        pytest.skip("real data is not here: ../shared/data/vlp16-diamond-board")
    with tarfile.open(tmp_path / "frames.tar", "w") as archive:
        archive.add(FRAMES, "frames")
    bag = Rosbag1Recording(FRAMES.parent / "recording.bag", ReadOptions())
    of_bag = list(islice(bag.sweeps(bag.sensors[0]), 4))  # the bag begins with poses 1, 3, 5, 7
    bag.close()
    for path in (FRAMES, tmp_path / "frames.tar", zipped(FRAMES, tmp_path / "frames.zip")):
        recording = open_recording(path)
        assert isinstance(recording, FolderRecording)
        items = [item for _, item in recording.messages(recording.sensors)]
        recording.close()
        sweeps = [item for item in items if isinstance(item, Sweep)]
        assert (len(items), len(sweeps)) == (8, 4)
        for sweep, twin in zip(sweeps, of_bag, strict=True):
            np.testing.assert_allclose(sweep.xyz, twin.xyz, atol=1e-6)
            np.testing.assert_array_equal(sweep.ring, twin.ring)
            np.testing.assert_array_equal(sweep.intensity, twin.intensity)


def test_the_real_road_scene(tmp_path):
    if not LANES.exists():
        pytest.skip("real data is not here: ../shared/data/road-lane-markers")
    for name in ("calib.pcd", "calib.png"):
        shutil.copy(LANES / name, tmp_path / f"{name.replace('calib', 'calib1')}")
    recording = open_recording(tmp_path)
    camera, lidar = recording.sensors
    (sweep,) = recording.sweeps(lidar)
    assert len(sweep.xyz) == 85546 and recording.lidar_facts(lidar).ring_count == 64
    assert (camera.notes["width"], camera.notes["height"]) == ("1920", "1200")
    recording.close()


@pytest.mark.parametrize("packing", ["tar", "zip"])
def test_a_ros2_bag_packed_without_its_top_folder_is_read(tmp_path, packing):
    bag = tmp_path / "walk"
    write_ros2(bag, rig())
    packed = tmp_path / f"walk.{packing}"
    if packing == "tar":
        with tarfile.open(packed, "w") as archive:
            for file in sorted(bag.iterdir()):
                archive.add(file, file.name)
    else:
        with zipfile.ZipFile(packed, "w") as archive:
            for file in sorted(bag.iterdir()):
                archive.write(file, file.name)
    recording, plain = open_recording(packed), open_recording(bag)
    assert names(recording) == names(plain)
    lidar = next(sensor for sensor in recording.sensors if sensor.kind == "lidar")
    assert len(list(recording.sweeps(lidar))) == lidar.count
    recording.close()
    plain.close()
