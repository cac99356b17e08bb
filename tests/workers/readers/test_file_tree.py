import io
import tarfile

import pytest

from workers.readers import file_tree
from workers.readers.file_tree import Folder, Tar
from workers.readers.recording import ReadError


def member(name, data=b"data", kind=tarfile.REGTYPE, link=""):
    info = tarfile.TarInfo(name)
    info.size, info.type, info.linkname = len(data) if kind == tarfile.REGTYPE else 0, kind, link
    return info, data


def packed(path, *members):
    with tarfile.open(path, "w") as archive:
        for info, data in members:
            archive.addfile(info, io.BytesIO(data))
    return path


def refused(make):
    with pytest.raises(ReadError) as caught:
        make()
    assert caught.value.hint
    return caught.value


def test_a_folder_and_its_tar_hold_the_same(tmp_path):
    root = tmp_path / "recording"
    (root / "lidar").mkdir(parents=True)
    (root / "lidar" / "1.pcd").write_bytes(b"one")
    (root / "2.png").write_bytes(b"two")
    (root / ".hidden").write_bytes(b"no")
    with tarfile.open(tmp_path / "a.tar", "w") as archive:
        archive.add(root, "recording")
    for tree in (Folder(root), Tar(tmp_path / "a.tar")):
        assert tree.paths == ["2.png", "lidar/1.pcd"]
        assert (tree.read("2.png"), tree.read("lidar/1.pcd")) == (b"two", b"one")
        tree.close()


@pytest.mark.parametrize(
    "bad",
    [
        member("../evil.png"),
        member("/etc/evil.png"),
        member("a/../../evil.png"),
        member("a.png", kind=tarfile.SYMTYPE, link="/etc/passwd"),
        member("a.png", kind=tarfile.LNKTYPE, link="b.png"),
        member("a.png", kind=tarfile.FIFOTYPE),
        member("a.png", kind=tarfile.CHRTYPE),
    ],
)
def test_paths_that_climb_and_files_that_are_none(tmp_path, bad):
    path = packed(tmp_path / "a.tar", member("fine.png"), bad)
    assert refused(lambda: Tar(path)).code == "folder_refused"


def test_links_in_a_folder(tmp_path):
    (tmp_path / "a.png").symlink_to("/etc/passwd")
    assert "a.png is a link" in refused(lambda: Folder(tmp_path)).message


@pytest.mark.parametrize("part", [700, 1100, 1600, 2048, 2600])
def test_a_tar_cut_short_anywhere(tmp_path, part):
    path = packed(tmp_path / "a.tar", member("a.png", b"a" * 600), member("b.png", b"b" * 600))
    path.write_bytes(path.read_bytes()[:part])
    assert refused(lambda: Tar(path)).code == "recording_truncated"


def test_a_tar_with_a_broken_header_in_its_middle(tmp_path):
    path = packed(tmp_path / "a.tar", member("a.png", b"a" * 600), member("b.png", b"b" * 600))
    data = bytearray(path.read_bytes())
    data[1536 + 148] ^= 1  # checksum of the second header
    path.write_bytes(data)
    assert refused(lambda: Tar(path)).code == "recording_truncated"


def test_absurd_sizes(tmp_path, monkeypatch):
    monkeypatch.setattr(file_tree, "MAX_FILE_BYTES", 3)
    monkeypatch.setattr(file_tree, "MAX_FILES", 2)
    path = packed(tmp_path / "a.tar", member("a.png"))
    tree = Tar(path)
    assert refused(lambda: tree.read("a.png")).code == "folder_refused"
    tree.close()
    path = packed(tmp_path / "b.tar", *(member(f"{i}.png") for i in range(3)))
    assert "more than 2 files" in refused(lambda: Tar(path)).message
