import pytest

from workers.readers.recording import ReadError
from workers.readers.trees.file_times import kitti_times, stamp_files, stem_and_number


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("1700000000123456789", 1_700_000_000_123_456_789),
        ("1700000000123456", 1_700_000_000_123_456_000),
        ("1700000000123", 1_700_000_000_123_000_000),
        ("1700000000", 1_700_000_000_000_000_000),
        ("1700000000.123456789", 1_700_000_000_123_456_789),
        ("12.5", 12_500_000_000),
    ],
)
def test_times_in_names(text, stamp):
    times = stamp_files({"lidar": [f"lidar/{text}.pcd"], "camera": [f"cam_{text}.png"]}, {}, {})
    assert set(times.stamps_ns.values()) == {stamp} and not times.warnings
    assert times.sources == {"lidar": "names", "camera": "names"}


def test_kitti_s_ten_digits_are_numbers_and_no_seconds():
    files = {"lidar": [f"{i:010d}.bin" for i in range(3)], "camera": [f"{i:010d}.png" for i in range(3)]}
    times = stamp_files(files, {}, {})
    assert times.stamps_ns["0000000002.bin"] == times.stamps_ns["0000000002.png"] == 1_200_000_000
    assert set(times.sources.values()) == {"index"} and "made up" in times.warnings[0]


def test_numbers_pair_files_and_the_made_up_times_are_said():
    times = stamp_files({"lidar": ["pose1.pcd", "pose3.pcd"], "camera": ["pose1.png", "pose03.png"]}, {}, {})
    assert times.stamps_ns["pose1.pcd"] == times.stamps_ns["pose1.png"] == 1_100_000_000
    assert times.stamps_ns["pose3.pcd"] == times.stamps_ns["pose03.png"] == 1_300_000_000
    assert set(times.sources.values()) == {"index"} and "made up" in times.warnings[0]


def test_a_table_wins_over_names():
    table = "\ufefffile, stamp_ns\r\na.pcd, 17\r\nsub/b.png, 18\r\nother.txt, 19\r\n".encode()
    groups = {"lidar": ["top/a.pcd"], "camera": ["top/sub/b.png"]}
    times = stamp_files(groups, {"top/timestamps.csv": table}, {"camera": b"2011-09-26 13:02:25.1\n"})
    assert times.stamps_ns == {"top/a.pcd": 17, "top/sub/b.png": 18}
    assert set(times.sources.values()) == {"csv"}


def test_a_table_for_one_sensor_and_times_in_the_names_of_the_other():
    table = b"file,stamp_ns\n1.png,1700000000000000017\n"
    groups = {"images": ["images/1.png"], "clouds": ["clouds/1700000000.5.pcd"]}
    times = stamp_files(groups, {"images/timestamps.csv": table}, {})
    assert times.stamps_ns == {
        "images/1.png": 1_700_000_000_000_000_017,
        "clouds/1700000000.5.pcd": 1_700_000_000_500_000_000,
    }


KITTI = b"2011-09-26 13:02:25.951199337\n2011-09-26 13:02:26.05\n\n2011-09-26 13:02:26.258\n"
FIRST_NS = 1_317_042_145_951_199_337


def test_kittis_lines_count_frames_from_0_and_lost_ones_are_left_out():
    paths = ["d/0000000000.bin", "d/0000000003.bin"]
    times = stamp_files({"velodyne_points": paths}, {}, {"velodyne_points": KITTI})
    assert times.stamps_ns == {paths[0]: FIRST_NS, paths[1]: FIRST_NS - 951_199_337 + 1_258_000_000}
    assert times.sources == {"velodyne_points": "kitti"}
    with pytest.raises(ReadError, match=r"no line for d/0000000002\.bin") as caught:
        stamp_files({"velodyne_points": ["d/0000000002.bin"]}, {}, {"velodyne_points": KITTI})
    assert caught.value.code == "timestamps_incomplete"


def test_lines_for_files_that_are_numbered_otherwise_count_by_order():
    times = stamp_files({"camera": ["b7.png", "a9.png"]}, {}, {"camera": b"1700000000.25\n1700000001000000000"})
    assert times.stamps_ns == {"a9.png": 1_700_000_000_250_000_000, "b7.png": 1_700_000_001_000_000_000}
    with pytest.raises(ReadError) as caught:
        stamp_files({"camera": ["b7.png", "a9.png"]}, {}, {"camera": KITTI})
    assert caught.value.code == "timestamps_incomplete" and "4 lines for 2 files" in caught.value.message


@pytest.mark.parametrize("line", [b"2011-13-26 13:02:25", b"yesterday", b"2011-09-26", b"-5", b"\xff", b"9" * 400])
def test_lines_that_are_no_times(line):
    with pytest.raises(ReadError, match="line 2") as caught:
        kitti_times(b"2011-09-26 13:02:25\n" + line, "timestamps.txt")
    assert caught.value.code == "timestamps_malformed"


@pytest.mark.parametrize(
    ("paths", "tables", "code", "said"),
    [
        (["calib.pcd", "pose1.png"], {}, "files_without_times", "calib.pcd"),
        (["1700000000.5.pcd", "x7.png"], {}, "files_without_times", "x7.png"),
        (["a.pcd"], {"timestamps.csv": b"file,stamp_ns\nb.pcd,1\n"}, "timestamps_incomplete", "a.pcd"),
        (["a.pcd"], {"timestamps.csv": b"file,stamp_ns\na.pcd,1.5\n"}, "timestamps_malformed", "line 2"),
        (["a.pcd"], {"timestamps.csv": b"file,stamp_ns\na.pcd\n"}, "timestamps_malformed", "line 2"),
        (["a.pcd"], {"timestamps.csv": b"name,time\na.pcd,1\n"}, "timestamps_malformed", "name, time"),
        (["a.pcd"], {"timestamps.csv": b"\xff\xfe\0"}, "timestamps_malformed", "no CSV text"),
        (["a.pcd"], {"timestamps.csv": b"file,stamp_ns\na.pcd,-5\n"}, "timestamps_malformed", "line 2"),
        (["a.pcd"], {"timestamps.csv": b"file,stamp_ns\na.pcd," + b"9" * 30}, "timestamps_malformed", "line 2"),
        (["9999999999999.5.pcd"], {}, "files_without_times", "2262"),
        (["12345678901.pcd"], {}, "files_without_times", "12345678901"),
    ],
)
def test_what_gives_no_times(paths, tables, code, said):
    with pytest.raises(ReadError) as caught:
        stamp_files({"sensor": paths}, tables, {})
    assert caught.value.code == code and said in caught.value.message


def test_the_number_stands_at_the_end():
    assert stem_and_number("a2/left_cam2_0012.png") == ("left_cam2_", "0012")
    assert stem_and_number("calib.png") == ("calib", "")
