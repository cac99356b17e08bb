"""What is uploaded: files as they are, folders as a tar that is the same every time."""

import io
import os
import tarfile

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from apexcal.errors import ClientError
from apexcal.upload_sources import FileSource, FolderSource, open_source


@pytest.fixture
def folder(tmp_path):
    root = tmp_path / "poses"
    (root / "lidar").mkdir(parents=True)
    (root / "camera").mkdir()
    (root / "lidar" / "1600000000.000000000.pcd").write_bytes(b"cloud" * 700)
    (root / "camera" / "1600000000.012000000.jpg").write_bytes(b"\xff\xd8image")
    (root / "camera" / ("ü" * 60 + "-long" * 10 + ".jpg")).write_bytes(b"x" * 512)
    (root / "empty.csv").write_bytes(b"")
    (root / ".hidden").write_bytes(b"no")
    return root


def unpacked(data: bytes) -> dict[str, bytes]:
    with tarfile.open(fileobj=io.BytesIO(data), mode="r:") as archive:
        return {member.name: archive.extractfile(member).read() for member in archive.getmembers()}


def test_a_folder_is_a_tar_of_its_files(folder):
    source = open_source(folder)
    assert source.name == "poses.tar"
    assert unpacked(source.read(0, source.size)) == {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith(".")
    }


def test_a_folder_is_the_same_bytes_whatever_its_times_and_owners(folder):
    first = FolderSource(folder)
    before = first.read(0, first.size)
    for path in folder.rglob("*"):
        os.utime(path, (1, 1))
        path.chmod(0o700)
    second = FolderSource(folder)
    assert second.read(0, second.size) == before


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(offset=st.integers(0, 9000), length=st.integers(0, 9000))
def test_any_piece_of_a_folder_is_that_piece_of_the_whole(folder, offset, length):
    source = FolderSource(folder)
    assert source.read(offset, length) == source.read(0, source.size)[offset : offset + length]


def test_a_file_that_shrinks_while_it_is_read_is_said(folder):
    source = FolderSource(folder)
    (folder / "lidar" / "1600000000.000000000.pcd").write_bytes(b"short")
    with pytest.raises(ClientError, match="became shorter"):
        source.read(0, source.size)


def test_nothing_to_upload_is_said(tmp_path):
    (tmp_path / "empty.bag").touch()
    (tmp_path / "folder").mkdir()
    for path, complaint in ((tmp_path / "none.bag", "no file or folder"), (tmp_path / "folder", "holds no files")):
        with pytest.raises(ClientError, match=complaint):
            open_source(path)
    with pytest.raises(ClientError, match="is empty"):
        FileSource(tmp_path / "empty.bag")
