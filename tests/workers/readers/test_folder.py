import tarfile

import numpy as np
import pytest
from making_recordings import DATA, png, png_claiming, scene
from pypcd4 import Encoding, PointCloud

from workers.readers.detect import open_recording
from workers.readers.folder import FolderRecording
from workers.readers.recording import ReadError, ReadOptions, Sweep
from workers.readers.rosbag1 import Rosbag1Recording

FRAMES = DATA / "vlp16-diamond-board" / "frames"
FIELDS = {"x": np.float32, "y": np.float32, "z": np.float32, "intensity": np.float32, "ring": np.uint16}


def write_pcd(path, fields=FIELDS, encoding=Encoding.BINARY):
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = [scene()[name].astype(form) for name, form in fields.items()]
    PointCloud.from_points(columns, list(fields), list(fields.values())).save(path, encoding)


def write_png(path, grey=0):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png(8, 6, grey))


def test_a_subfolder_per_sensor_merged_by_time(tmp_path):
    for i in range(3):
        write_pcd(tmp_path / "velodyne" / f"{1_700_000_000_000_000_000 + i * 100_000_000}.pcd")
        write_png(tmp_path / "front" / f"{1_700_000_000_012 + i * 100}.png", i)
        write_png(tmp_path / "rear" / f"{1_700_000_000_050 + i * 100}.png", i)
    recording = FolderRecording(tmp_path, ReadOptions())
    assert [(s.kind, s.name, s.count) for s in recording.sensors] == [
        ("camera", "front", 3),
        ("camera", "rear", 3),
        ("lidar", "velodyne", 3),
    ]
    messages = list(recording.messages(recording.sensors))
    assert [sensor.name for sensor, _ in messages] == ["velodyne", "front", "rear"] * 3
    assert recording.warnings == []
    facts = recording.lidar_facts(recording.sensors[2])
    assert (facts.time_source, facts.sweep_ns) == ("derived_from_azimuth", 100_000_000)


def test_several_sensors_in_one_folder_by_their_names(tmp_path):
    for i in range(2):
        write_pcd(tmp_path / f"cloud_{i}.pcd")
        write_png(tmp_path / f"left_{i}.png")
        write_png(tmp_path / f"right_{i}.png")
    recording = FolderRecording(tmp_path, ReadOptions())
    assert [s.name for s in recording.sensors] == ["left", "right", "clouds"]


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


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda root: (root / "notes.txt").write_text("nothing"), "folder_empty"),
        (
            lambda root: write_pcd(root / "1.pcd", dict.fromkeys("xyz", np.float32)),
            "cloud_without_rings",
        ),
        (lambda root: (root / "1.png").write_bytes(png_claiming(60000, 60000)), "image_too_large"),
        (lambda root: (root / "1.jpg").write_bytes(b"text"), "image_unsupported"),
        (lambda root: (root / "1.pcd").write_bytes(b"text"), "cloud_malformed"),
    ],
)
def test_what_cannot_be_used_names_the_file(tmp_path, make, code):
    make(tmp_path)
    with pytest.raises(ReadError) as caught:
        recording = FolderRecording(tmp_path, ReadOptions())
        list(recording.messages(recording.sensors))
    assert caught.value.code == code
    assert code == "folder_empty" or "1." in caught.value.message or "clouds" in caught.value.message


def test_the_real_frames_are_the_real_bags(tmp_path):
    if not FRAMES.exists():
        pytest.skip("real data is not here: ../shared/data/vlp16-diamond-board")
    with tarfile.open(tmp_path / "frames.tar", "w") as archive:
        archive.add(FRAMES, "frames")
    bag = Rosbag1Recording(FRAMES.parent / "recording.bag", ReadOptions())
    of_bag = list(bag.sweeps(bag.sensors[0]))
    bag.close()
    for path in (FRAMES, tmp_path / "frames.tar"):
        recording = open_recording(path)
        assert isinstance(recording, FolderRecording)
        items = [item for _, item in recording.messages(recording.sensors)]
        recording.close()
        sweeps = [item for item in items if isinstance(item, Sweep)]
        assert (len(items), len(sweeps)) == (8, 4)
        for sweep, twin in zip(sweeps, of_bag[:4], strict=True):  # the bag begins with poses 1, 3, 5, 7
            np.testing.assert_allclose(sweep.xyz, twin.xyz, atol=1e-6)
            np.testing.assert_array_equal(sweep.ring, twin.ring)
            np.testing.assert_array_equal(sweep.intensity, twin.intensity)
