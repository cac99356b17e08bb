"""Folders: which files are one sensor, when each was taken, and what lies beside them."""

import cv2
import numpy as np
import pytest
from formats import CLOUDS, folder_of, frames_of, read, sweeps_of, tar_of, zip_of
from making_recordings import CLOUD, PERIOD_NS, START_NS, cloud, clouds, images, png, scene, write_bag
from making_videos import TIMES_MS, number_of, write_video

from workers.readers.detect import open_recording
from workers.readers.inspection import inspect_recording
from workers.readers.normalised.normalise import normalise
from workers.readers.recording import ReadError
from workers.readers.trees.file_times import kitti_times, stamp_series
from workers.readers.trees.series import Series, find_series, stem_and_number

PCD = CLOUDS["binary.pcd"]


def names(recording):
    return [(sensor.kind, sensor.name, sensor.count) for sensor in recording.sensors]


def test_sensors_merged_by_time(tmp_path):
    files = {f"velodyne/{START_NS + i * PERIOD_NS}.pcd": PCD for i in range(3)}
    for name, after_ms in (("front", 12), ("rear", 50)):
        files |= {f"{name}/{START_NS // 10**6 + after_ms + i * 100}.png": png(8, 6, i) for i in range(3)}
    recording = open_recording(folder_of(tmp_path / "walk", files))
    assert names(recording) == [("camera", "front", 3), ("camera", "rear", 3), ("lidar", "velodyne", 3)]
    front, _, lidar = recording.sensors
    assert (front.notes["width"], front.notes["height"]) == ("8", "6")
    assert lidar.notes["fields"] == "x y z intensity ring"
    assert [s.name for s, _ in recording.messages(recording.sensors)] == ["velodyne", "front", "rear"] * 3
    assert [s.name for s, _ in recording.messages([lidar, front])] == ["velodyne", "front"] * 3
    facts = recording.lidar_facts(lidar)
    assert (facts.time_source, facts.sweep_ns, recording.warnings) == ("derived_from_azimuth", 100_000_000, [])
    recording.close()


@pytest.mark.parametrize(
    ("paths", "sensors"),
    [
        ([f"{stem}_{i}.{s}" for i in (0, 1) for stem, s in (("cloud", "pcd"), ("left", "png"), ("right", "png"))],
         {"left": 2, "right": 2, "clouds": 2}),
        (["walk/frames/1.pcd", "walk/frames/1.png"], {"walk/frames/images": 1, "walk/frames/clouds": 1}),
        ([f"{place}{i}.pcd" for i in (1, 2) for place in ("", "clouds/", "walk/", "walk/data/")],
         {"clouds": 2, "clouds_2": 2, "walk": 2, "walk_2": 2}),
    ],
)  # fmt: skip
def test_files_of_one_kind_in_one_folder_are_one_sensor(paths, sensors):
    assert {one.name: len(one.paths) for one in find_series(paths)} == sensors


POINTS = b"x,y,z\n1,2,3\n4,5,6\n"
CORNERS = b"pose,corner,x,y,z\n1,0,1.5,2.5,3.5\n"
PAIRS = b"x,y,z,u,v,group\n1,2,3,4,5,1\n"


@pytest.mark.parametrize(
    ("beside", "is_told"),
    [
        ({"hand_fits.csv": CORNERS}, False),
        ({"pairs.csv": PAIRS, "corners.csv": CORNERS}, False),
        ({"clouds/corners.csv": CORNERS}, False),
        ({f"corners/{i}.csv": CORNERS for i in range(1, 5)}, False),
        ({"tips.csv": POINTS}, True),
        ({"clouds/tips.csv": POINTS}, True),
        ({"map.pcd": PCD}, True),
        ({"map_2.pcd": PCD, "setup.png": png(8, 6, 9)}, True),
        ({"clouds/merged.pcd": PCD, "images/overview.png": png(8, 6, 9)}, True),
    ],
    ids=lambda each: "-".join(each) if isinstance(each, dict) else "",
)
def test_files_beside_that_are_no_sweeps_are_no_second_sensor(tmp_path, beside, is_told):
    files = {f"clouds/{i}.pcd": PCD for i in range(1, 5)} | {f"images/{i}.png": png(8, 6, i) for i in range(1, 5)}
    recording = open_recording(folder_of(tmp_path / "poses", files | beside))
    assert names(recording) == [("camera", "images", 4), ("lidar", "clouds", 4)]
    assert all(any(path in line for line in recording.other_topics) for path in beside)
    assert any("left out" in warning for warning in recording.warnings) == is_told
    recording.close()


def test_two_sensors_with_as_many_files_stay_two(tmp_path):
    """What is clear of one sensor is not guessed of two: their owner says which is the LiDAR."""
    files = {f"{name}/{i}.pcd": PCD for name in ("left", "right") for i in range(3)}
    recording = open_recording(folder_of(tmp_path / "poses", files | {"images/0.png": png(8, 6)}))
    assert names(recording) == [("camera", "images", 1), ("lidar", "left", 3), ("lidar", "right", 3)]
    recording.close()


def test_numbered_files_are_simultaneous_and_each_sweep_one_moment(tmp_path):
    files = {f"pose{i}.{suffix}": data for i in (2, 10, 9) for suffix, data in (("pcd", PCD), ("png", png(8, 6, i)))}
    _, items, warnings = read(folder_of(tmp_path, files))
    sweeps, frames = sweeps_of(items), frames_of(items)
    assert [s.stamp_ns for s in sweeps] == [f.stamp_ns for f in frames]
    assert [f.data for f in frames] == [png(8, 6, i) for i in (2, 9, 10)]
    assert {s.time_source for s in sweeps} == {"stamp_only"} and not sweeps[0].offset_ns.any()
    assert len(warnings) == 1 and "made up" in warnings[0]


def test_made_up_times_are_told_as_no_measurement(tmp_path):
    """Poses 2, 9 and 10: neither a rate of 10 Hz nor six messages that are missing."""
    files = {
        f"pose{i}.{suffix}": data for i in (2, 9, 10) for suffix, data in (("pcd", PCD), ("png", png(32, 24, i)))
    }
    folder = folder_of(tmp_path, files)
    inspection = inspect_recording(folder)
    manifest = normalise(folder, tmp_path / "out", cameras=["front"])
    assert all((s.rate_hz, s.missing, s.gap_count, s.gaps) == (None, 0, 0, []) for s in manifest.sensors)
    assert not any("missing" in sentence or "Hz" in sentence for sentence in manifest.warnings)
    assert manifest.facts()["seconds"] == manifest.facts()["together_s"] == 0.0
    assert {(s.rate_hz, s.longest_pause_s) for s in inspection.sensors} == {(None, None)}
    assert not {fault.code for fault in inspection.faults} & {"gap", "too_short"}


def mixed(folder):
    """A bag with a LiDAR and a camera, a video with its table, and two folders of images: one with a table."""
    files = {"walk.bag": write_bag(folder / "a", [*clouds(3), *images(3)]).read_bytes()}
    files["rear.mp4"] = write_video(folder / "b.mp4").read_bytes()
    rows = [f"{i},{START_NS + ms * 1_000_000}" for i, ms in enumerate(TIMES_MS)]
    files["rear.csv"] = ("frame,stamp_ns\n" + "\n".join(rows)).encode()
    files |= {f"images/left/{START_NS + i * 50_000_000}.png": png(8, 6, i) for i in range(2)}
    files |= {f"images/right/{i}.png": png(8, 6, i) for i in range(2)}
    files["images/right.csv"] = f"file,stamp_ns\nright/0.png,{START_NS}\nright/1.png,{START_NS + 9}\n".encode()
    return files | {"notes.txt": b"windy"}


@pytest.mark.parametrize("pack", [folder_of, zip_of, tar_of])
def test_a_bag_a_video_and_folders_of_images_are_one_recording(tmp_path, pack):
    path = tmp_path / "walk"
    if pack is folder_of:
        folder_of(path, mixed(tmp_path))
    else:
        path.write_bytes(pack(mixed(tmp_path)))
    recording = open_recording(path)
    assert recording.format == "folder+rosbag1+video"
    assert sorted(names(recording)) == [
        *(("camera", "/camera/compressed", 3), ("camera", "images/left", 2), ("camera", "images/right", 2)),
        *(("camera", "rear.mp4", 10), ("lidar", "/points", 3)),
    ]
    assert len(recording.other_topics) == 1 and "notes.txt" in recording.other_topics[0]
    messages = list(recording.messages(recording.sensors))
    stamps = [item.stamp_ns for _, item in messages]
    assert stamps == sorted(stamps) and len(stamps) == 20
    rear = [np.frombuffer(item.data, np.uint8) for sensor, item in messages if sensor.name == "rear.mp4"]
    assert [number_of(cv2.imdecode(data, cv2.IMREAD_COLOR_RGB)) for data in rear] == list(range(10))
    assert recording.warnings == []
    recording.close()


def test_equal_topics_of_two_bags_are_told_apart(tmp_path):
    write_bag(tmp_path / "a.bag", clouds(2))
    write_bag(tmp_path / "b.bag", [("/points", CLOUD, START_NS, cloud(START_NS, scene())), *images(1)])
    recording = open_recording(tmp_path)
    assert [s.name for s in recording.sensors] == ["a.bag:/points", "b.bag:/points", "/camera/compressed"]
    assert len(list(recording.sweeps(recording.sensors[0]))) == 2
    recording.close()


def test_a_video_whose_start_is_in_the_table(tmp_path):
    write_video(tmp_path / "camera.mkv", created=None)
    (tmp_path / "timestamps.csv").write_text("file,stamp_ns\ncamera.mkv,12345678901234\n")
    recording = open_recording(tmp_path)
    (camera,) = recording.sensors
    assert (camera.name, next(recording.frames(camera)).stamp_ns) == ("camera.mkv", 12345678901234)
    recording.close()


def test_a_picture_without_a_time_is_left_out_beside_a_whole_bag_only(tmp_path):
    (tmp_path / "overview.png").write_bytes(png(8, 6))
    write_bag(tmp_path / "walk.bag", [*clouds(2), *images(2)])
    recording = open_recording(tmp_path)
    assert [s.name for s in recording.sensors] == ["/points", "/camera/compressed"]
    assert "images were left out" in recording.warnings[0]
    recording.close()
    (tmp_path / "walk.bag").unlink()
    write_bag(tmp_path / "walk.bag", clouds(2))
    with pytest.raises(ReadError, match="images") as caught:
        open_recording(tmp_path)
    assert caught.value.code == "files_without_times"


KITTI_SECONDS = (25.951, 26.054, 26.257)


def test_kittis_raw_layout(tmp_path):
    """With its folders of date and drive; the LiDAR lost frame 1. A stamp is when the scanner looks ahead."""
    xyz = np.stack([scene()[axis] for axis in "xyz"], 1).astype(np.float32)
    order = np.lexsort((np.arctan2(xyz[:, 1], xyz[:, 0]), -scene()["ring"]))
    files, drive = {}, "2011_09_26/2011_09_26_drive_0001_extract"
    for name, shift in {"timestamps.txt": 0.0, "timestamps_start.txt": -0.05, "timestamps_end.txt": 0.051}.items():
        lines = "".join(f"2011-09-26 13:02:{second + shift:012.9f}\n" for second in KITTI_SECONDS).encode()
        files[f"{drive}/velodyne_points/{name}"] = lines
        files |= {f"{drive}/{sensor}/timestamps.txt": lines for sensor in ("image_02", "oxts") if shift == 0.0}
    for i in range(3):
        points = np.column_stack([xyz, np.full(len(xyz), 0.5 + i)])[order].astype("<f4")
        files[f"{drive}/image_02/data/{i:010d}.png"] = png(8, 6, i)
        files[f"{drive}/oxts/data/{i:010d}.txt"] = b"49.0 8.4 112.8\n"
        files |= {f"{drive}/velodyne_points/data/{i:010d}.bin": points.tobytes()} if i != 1 else {}
    recording = open_recording(folder_of(tmp_path, files))
    assert names(recording) == [("camera", "image_02", 3), ("lidar", "velodyne_points", 2)]
    camera, lidar = recording.sensors
    stamps = [1_317_042_120_000_000_000 + round(second * 1000) * 1_000_000 for second in KITTI_SECONDS]
    assert [f.stamp_ns for f in recording.frames(camera)] == stamps
    facts = recording.lidar_facts(lidar)
    assert (facts.ring_count, facts.time_source) == (16, "stamp_only")
    first, second = recording.sweeps(lidar)
    assert [first.stamp_ns, second.stamp_ns] == [stamps[0], stamps[2]]
    np.testing.assert_array_equal(first.xyz, xyz[order])
    np.testing.assert_array_equal(first.ring, scene()["ring"][order])
    np.testing.assert_array_equal(second.intensity, np.float32(2.5))
    assert not first.offset_ns.any()
    recording.close()


def stamped(groups, tables=None, lines=None):
    """Stamps by path, and where those of each sensor come from."""
    series = [Series("lidar", name, ".", list(paths)) for name, paths in groups.items()]
    stamp_series(series, tables or {}, lines or {})
    return {k: v for one in series for k, v in one.stamps_ns.items()}, {one.name: one.times_from for one in series}


KITTI = b"2011-09-26 13:02:25.951199337\n2011-09-26 13:02:26.05\n\n2011-09-26 13:02:26.258\n"
FIRST_NS = 1_317_042_145_951_199_337
TABLE = "\ufefffile, stamp_ns\r\na.pcd, 17\r\nsub/b.png, 18\r\nother.txt, 19\r\n".encode()


@pytest.mark.parametrize(
    ("groups", "how", "stamps", "source"),
    [
        *(
            ({"lidar": [f"lidar/{text}.pcd"], "camera": [f"cam_{text}.png"]}, (), [stamp] * 2, "names")
            for text, stamp in (
                ("1700000000123456789", 1_700_000_000_123_456_789),
                ("1700000000123456", 1_700_000_000_123_456_000),
                ("1700000000123", 1_700_000_000_123_000_000),
                ("1700000000", 1_700_000_000_000_000_000),
                ("1700000000.123456789", 1_700_000_000_123_456_789),
                ("12.5", 12_500_000_000),
            )
        ),
        # Ten digits that begin with 0 are KITTI's numbers and no seconds.
        ({"a": ["0000000002.bin"], "b": ["0000000002.png"]}, (), [1_200_000_000] * 2, "index"),
        ({"a": ["pose3.pcd"], "b": ["pose03.png"]}, (), [1_300_000_000] * 2, "index"),
        ({"a": ["top/a.pcd"], "b": ["top/sub/b.png"]}, ({"top/timestamps.csv": TABLE}, {"b": KITTI}),
         [17, 18], "csv"),
        ({"a": ["d/0000000000.bin", "d/0000000003.bin"]}, ({}, {"a": KITTI}),
         [FIRST_NS, FIRST_NS + 306_800_663], "kitti"),
        ({"a": ["b7.png", "a9.png"]}, ({}, {"a": b"1700000000.25\n1700000001000000000"}),
         [1_700_000_001_000_000_000, 1_700_000_000_250_000_000], "kitti"),
    ],
)  # fmt: skip
def test_stamps_come_from_tables_names_or_numbers(groups, how, stamps, source):
    found, sources = stamped(groups, *how)
    assert [found[path] for paths in groups.values() for path in paths] == stamps
    assert set(sources.values()) == {source}


def test_a_table_for_one_sensor_and_times_in_the_names_of_the_other():
    groups = {"images": ["images/1.png"], "clouds": ["clouds/1700000000.5.pcd"]}
    stamps, _ = stamped(groups, {"images/timestamps.csv": b"file,stamp_ns\n1.png,1700000000000000017\n"})
    assert list(stamps.values()) == [1_700_000_000_000_000_017, 1_700_000_000_500_000_000]


NONE, MISSING, MALFORMED = "files_without_times", "timestamps_incomplete", "timestamps_malformed"


@pytest.mark.parametrize(
    ("paths", "table", "lines", "code", "reason"),
    [
        (["calib.pcd", "pose1.png"], None, None, NONE, "calib.pcd"),
        (["1700000000.5.pcd", "x7.png"], None, None, NONE, "x7.png"),
        (["9999999999999.5.pcd"], None, None, NONE, "2262"),
        (["12345678901.pcd"], None, None, NONE, "12345678901"),
        (["a.pcd"], b"file,stamp_ns\nb.pcd,1\n", None, MISSING, "a.pcd"),
        (["a.pcd"], b"name,time\na.pcd,1\n", None, MALFORMED, "name, time"),
        (["a.pcd"], b"\xff\xfe\0", None, MALFORMED, "no CSV text"),
        *((["a.pcd"], b"file,stamp_ns\na.pcd" + end, None, MALFORMED, "line 2")
          for end in (b",1.5\n", b"\n", b",-5\n", b"," + b"9" * 30)),
        (["d/0000000002.bin"], None, KITTI, MISSING, "no line for d/0000000002.bin"),
        (["b7.png", "a9.png"], None, KITTI, MISSING, "4 lines for 2 files"),
    ],
)  # fmt: skip
def test_what_gives_no_times(paths, table, lines, code, reason):
    with pytest.raises(ReadError) as caught:
        stamped({"sensor": paths}, table and {"timestamps.csv": table}, lines and {"sensor": lines})
    assert caught.value.code == code and reason in caught.value.message and caught.value.hint


@pytest.mark.parametrize("line", [b"2011-13-26 13:02:25", b"yesterday", b"2011-09-26", b"-5", b"\xff", b"9" * 400])
def test_lines_that_are_no_times(line):
    with pytest.raises(ReadError, match="line 2") as caught:
        kitti_times(b"2011-09-26 13:02:25\n" + line, "timestamps.txt")
    assert caught.value.code == MALFORMED


def test_the_number_stands_at_the_end():
    assert stem_and_number("a2/left_cam2_0012.png") == ("left_cam2_", "0012")
    assert stem_and_number("calib.png") == ("calib", "")
