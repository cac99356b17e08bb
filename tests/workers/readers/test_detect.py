import sqlite3
import tarfile

import pytest
from making_recordings import clouds, png, write_bag

from workers.readers.detect import open_recording
from workers.readers.recording import ReadError


def refused(path):
    with pytest.raises(ReadError) as caught:
        open_recording(path)
    assert path.name in caught.value.message and caught.value.hint
    return caught.value


def test_the_content_counts_and_not_the_name(tmp_path):
    bag = write_bag(tmp_path / "walk.txt", clouds(2))
    (tmp_path / "1.png").write_bytes(png(4, 4))
    with tarfile.open(tmp_path / "folder.bag", "w", format=tarfile.GNU_FORMAT) as archive:
        archive.add(tmp_path / "1.png", "frames/1.png")
    formats = []
    for path in (bag, tmp_path / "folder.bag"):
        recording = open_recording(path)
        formats.append(recording.format)
        recording.close()
    assert formats == ["rosbag1", "folder"]


def test_an_old_tar_without_a_magic(tmp_path):
    path = tmp_path / "v7.tar"
    (tmp_path / "1.png").write_bytes(png(4, 4))
    with tarfile.open(path, "w") as archive:
        archive.add(tmp_path / "1.png", "1.png")
    data = bytearray(path.read_bytes())
    data[257:265] = bytes(8)
    data[148:156] = b" " * 8
    data[148:156] = f"{sum(data[:512]):06o}\0 ".encode()
    path.write_bytes(data)
    recording = open_recording(path)
    assert [s.kind for s in recording.sensors] == ["camera"]
    recording.close()


def test_a_text_file_named_bag(tmp_path):
    path = tmp_path / "walk.bag"
    path.write_text("This is no bag.\n" * 100)
    error = refused(path)
    assert error.code == "not_a_recording" and "a text file" in error.message and "ROS 1 bag" in error.hint


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (b"#ROSBAG V1.2\n" + bytes(100), "version 1.x"),
        (bytes([0, 1, 2, 255] * 100), "no format that is known"),
        ("längere Zeile ".encode() * 100, "a text file"),
    ],
)
def test_other_files_are_told_by_name(tmp_path, head, said):
    (tmp_path / "walk.bag").write_bytes(head)
    error = refused(tmp_path / "walk.bag")
    assert error.code == "not_a_recording" and said in error.message


def test_a_ros_2_bag(tmp_path):
    with sqlite3.connect(tmp_path / "walk.bag") as database:
        database.execute("create table messages (id)")
    database.close()
    assert "SQLite" in refused(tmp_path / "walk.bag").message


def test_no_bytes_a_few_bytes_and_no_file(tmp_path):
    (tmp_path / "a.bag").write_bytes(b"")
    assert refused(tmp_path / "a.bag").code == "recording_empty"
    (tmp_path / "b.bag").write_bytes(b"#ROSBAG")
    assert refused(tmp_path / "b.bag").code == "recording_truncated"
    assert refused(tmp_path / "c.bag").code == "recording_missing"


@pytest.mark.parametrize(
    "head", [b"7z\xbc\xaf\x27\x1c", b"Rar!\x1a\x07\x01\0", b"# .PCD v.7\nVERSION", b"\xff\xd8\xff\xe0"]
)
def test_what_people_upload_by_mistake_is_named(tmp_path, head):
    (tmp_path / "upload").write_bytes(head + bytes(600))
    error = refused(tmp_path / "upload")
    assert error.code == "not_a_recording" and "zip or tar" in error.hint
