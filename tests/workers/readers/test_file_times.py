import pytest

from workers.readers.file_times import stamp_files, stem_and_number
from workers.readers.recording import ReadError


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
    times = stamp_files([f"lidar/{text}.pcd", f"cam_{text}.png"], {})
    assert set(times.stamps_ns.values()) == {stamp} and times.source == "names" and not times.warnings


def test_numbers_pair_files_and_the_made_up_times_are_said():
    times = stamp_files(["pose1.pcd", "pose3.pcd", "pose1.png", "pose03.png"], {})
    assert times.stamps_ns["pose1.pcd"] == times.stamps_ns["pose1.png"] == 1_100_000_000
    assert times.stamps_ns["pose3.pcd"] == times.stamps_ns["pose03.png"] == 1_300_000_000
    assert times.source == "index" and "made up" in times.warnings[0]


def test_a_table_wins_over_names():
    table = "\ufefffile, stamp_ns\r\na.pcd, 17\r\nsub/b.png, 18\r\nother.txt, 19\r\n".encode()
    times = stamp_files(["top/a.pcd", "top/sub/b.png"], {"top/timestamps.csv": table})
    assert (times.stamps_ns, times.source) == ({"top/a.pcd": 17, "top/sub/b.png": 18}, "csv")


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
    ],
)
def test_what_gives_no_times(paths, tables, code, said):
    with pytest.raises(ReadError) as caught:
        stamp_files(paths, tables)
    assert caught.value.code == code and said in caught.value.message


def test_the_number_stands_at_the_end():
    assert stem_and_number("a2/left_cam2_0012.png") == ("left_cam2_", "0012")
    assert stem_and_number("calib.png") == ("calib", "")
