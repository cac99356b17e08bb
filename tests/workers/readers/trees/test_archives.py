"""Archives of strangers: what no archive of a recording holds is refused, and nothing is written elsewhere."""

import gzip
import io
import os
import stat
import struct
import tarfile
import zipfile

import numpy as np
import pytest
from formats import PACKINGS, zip_of
from making_recordings import png

from workers.readers import output
from workers.readers.detect import open_recording
from workers.readers.recording import ReadError
from workers.readers.trees import archives, file_tree, scratch
from workers.readers.trees.archives import open_tree
from workers.readers.trees.file_tree import Folder, read_file, read_head

FILES = {"2.png": b"two", "lidar/1.pcd": b"one" * 1000}
HIDDEN = {".hidden": b"no", "__MACOSX/x": b"no"}
NOISE = np.random.default_rng(0).bytes(60_000)
PACKED = [name for name in PACKINGS if name not in ("tar", "zip 0")]


def tar(path, *members, mode="w"):
    with tarfile.open(path, mode) as archive:
        for name, data, kind in members:
            info = tarfile.TarInfo(name)
            info.size, info.type, info.linkname = len(data) if kind == tarfile.REGTYPE else 0, kind, "/etc/passwd"
            archive.addfile(info, io.BytesIO(data))
    return path


def zipped(path, *members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data, mode in members:
            info = zipfile.ZipInfo(name)
            info.external_attr, info.compress_type = (mode | 0o644) << 16, zipfile.ZIP_DEFLATED
            archive.writestr(info, data)
    return path


def written(path, data):
    path.write_bytes(data)
    return path


def refused(make, code="folder_refused", reason=""):
    with pytest.raises(ReadError) as caught:
        make()
    assert caught.value.code == code and reason in caught.value.message and caught.value.hint, caught.value
    return caught.value


@pytest.mark.parametrize("name", ["folder", *PACKINGS])
def test_a_folder_and_its_archives_hold_the_same(tmp_path, name):
    path = tmp_path / "walk"
    if name == "folder":
        for member, data in (FILES | HIDDEN).items():
            (path / member).parent.mkdir(parents=True, exist_ok=True)
            (path / member).write_bytes(data)
    else:
        path.write_bytes(PACKINGS[name](FILES | HIDDEN))
    tree = open_tree(path)
    assert tree.paths == sorted(FILES) and {path: read_file(tree, path) for path in tree.paths} == FILES
    assert {path: tree.size(path) for path in tree.paths} == {path: len(data) for path, data in FILES.items()}
    assert read_head(tree, "lidar/1.pcd", 4) == b"oneo"
    file, folder = tree.on_disk("2.png"), tree.on_disk("lidar")
    assert (file.read_bytes(), (folder / "1.pcd").read_bytes()) == (b"two", FILES["lidar/1.pcd"])
    tree.close()
    assert file.exists() == (name == "folder")


@pytest.mark.parametrize(
    ("name", "inner"),
    [("walk.bag.gz", "walk.bag"), (".gz", "recording"), ("..gz", "recording"), ("...gz", "recording")],
)
def test_a_single_compressed_file_is_a_tree_of_one(tmp_path, name, inner):
    tree = open_tree(written(tmp_path / name, gzip.compress(b"#ROSBAG V2.0\n")))
    assert tree.paths == [inner] and read_file(tree, inner) == b"#ROSBAG V2.0\n"
    assert tree.on_disk(inner).name == inner
    tree.close()


CLIMBING = ("../evil.png", "/etc/evil.png", "a/../../evil.png", "..\\evil.png", "C:\\evil.png", "long/" + "x" * 300)
TWICE = ("fine.png", "fine.png/below.png")


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("pack", ["tar", "tar.gz", "zip"])
def test_paths_that_climb_and_files_that_are_none(tmp_path, pack):
    bad = [(name, tarfile.REGTYPE, stat.S_IFREG) for name in (*CLIMBING, *TWICE)]
    bad += [("a.png", tarfile.SYMTYPE, stat.S_IFLNK), ("a.png", tarfile.FIFOTYPE, stat.S_IFIFO)]
    bad += [("a.png", tarfile.LNKTYPE, stat.S_IFLNK), ("a.png", tarfile.CHRTYPE, stat.S_IFCHR)]
    for name, kind, mode in bad:
        if pack == "zip":
            path = zipped(tmp_path / "a", ("fine.png", b"fine", stat.S_IFREG), (name, b"bad", mode))
        else:
            members = (("fine.png", b"fine", tarfile.REGTYPE), (name, b"bad", kind))
            path = tar(tmp_path / "a", *members, mode="w:gz" if pack == "tar.gz" else "w")
        refused(lambda path=path: open_tree(path))


def test_links_and_pipes_in_a_folder(tmp_path):
    (tmp_path / "a.png").symlink_to("/etc/passwd")
    refused(lambda: Folder(tmp_path, "walk"), reason="'a.png' is a link")
    (tmp_path / "a.png").unlink()
    os.mkfifo(tmp_path / "a.png")
    refused(lambda: Folder(tmp_path, "walk"), reason="no ordinary file")


def directory(data):
    return data.index(b"PK\x01\x02")


def test_an_encrypted_zip(tmp_path):
    data = bytearray(zip_of({"a.png": b"data"}))
    for magic, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(magic) + offset] |= 1
    assert "password" in refused(lambda: open_tree(written(tmp_path / "a", data)), "archive_encrypted").hint


def test_a_zip_whose_files_overlap(tmp_path):
    """Many entries of a directory that share one compressed file unpack to far more than their own bytes."""
    data = bytearray(zip_of({"a.png": NOISE, "b.png": NOISE}))
    first = directory(data)
    second = data.index(b"PK\x01\x02", first + 1)
    data[second + 42 : second + 46] = bytes(4)  # its file is where the first one's is
    extra = b"".join(bytes(data[first:second]).replace(b"a.png", b"%05d" % i) for i in range(3))
    tail = bytearray(data[data.rindex(b"PK\x05\x06") :])
    struct.pack_into("<HHI", tail, 8, 5, 5, len(data) - len(tail) - first + len(extra))
    path = written(tmp_path / "a", bytes(data[: -len(tail)]) + extra + tail)
    refused(lambda: open_tree(path), reason="overlap")


@pytest.mark.parametrize("name", PACKED)
def test_archives_that_expand_without_end(tmp_path, monkeypatch, name):
    monkeypatch.setattr(archives, "HARMLESS_BYTES", 1_000_000)
    monkeypatch.setattr(output, "_WRITTEN", output._Written(most=1_000_000))
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr(scratch.tempfile, "tempdir", str(tmp_path / "scratch"))
    path = written(tmp_path / "walk", PACKINGS[name](dict.fromkeys(FILES, bytes(2_000_000))))
    refused(lambda: open_tree(path), "archive_expands")
    assert not list((tmp_path / "scratch").iterdir())


def test_a_zip_that_holds_more_than_it_says(tmp_path):
    data = bytearray(zip_of({"a.png": bytes(100_000)}))
    struct.pack_into("<I", data, directory(data) + 24, 1000)
    tree = open_tree(written(tmp_path / "a", data))
    refused(lambda: read_file(tree, "a.png"), "recording_truncated", "a.png")
    tree.close()


def test_a_zip_with_damaged_data(tmp_path):
    data = bytearray(zip_of({"a.png": NOISE, "b.png": b"fine"}))
    data[5000] ^= 255
    tree = open_tree(written(tmp_path / "a", data))
    refused(lambda: read_file(tree, "a.png"), "recording_truncated")
    assert read_file(tree, "b.png") == b"fine"
    tree.close()


def test_a_tar_with_a_broken_header_in_its_middle(tmp_path):
    data = bytearray(PACKINGS["tar"]({"a.png": b"a" * 600, "b.png": b"b" * 600}))
    data[1536 + 148] ^= 1  # checksum of the second header
    refused(lambda: open_tree(written(tmp_path / "a", data)), "recording_truncated")


@pytest.mark.parametrize("kind", [b"L", b"x"])
def test_a_tar_of_nothing_but_extension_headers(tmp_path, kind):
    text = b"30 mtime=1350244992.023960108\n" if kind == b"x" else b"a\0"
    info = tarfile.TarInfo("././@LongLink")
    info.type, info.size = kind, len(text)
    block = info.tobuf(tarfile.GNU_FORMAT) + text.ljust(512, b"\0")
    path = written(tmp_path / "a.tar", block * 3000 + bytes(10_240))
    refused(lambda: open_tree(path), "recording_truncated")


def test_absurd_sizes_and_counts(tmp_path, monkeypatch):
    monkeypatch.setattr(file_tree, "MAX_FILE_BYTES", 3)
    tree = open_tree(written(tmp_path / "a", PACKINGS["tar"]({"a.png": b"data"})))
    refused(lambda: read_file(tree, "a.png"), reason="at most 3")
    tree.close()
    monkeypatch.setattr(file_tree, "MAX_FILES", 2)
    many = {f"{i}.png": b"" for i in range(3)}
    for name in ("tar", "zip"):
        path = written(tmp_path / name, PACKINGS[name](many))
        refused(lambda path=path: open_tree(path), reason="more than 2 files")
    (tmp_path / "folder").mkdir()
    for name in many:
        (tmp_path / "folder" / name).touch()
    refused(lambda: open_tree(tmp_path / "folder"), reason="more than 2 files")


def test_an_old_tar_without_a_magic(tmp_path):
    data = bytearray(PACKINGS["tar"]({"1.png": png(4, 4)}))
    data[257:265] = bytes(8)
    data[148:156] = b" " * 8
    data[148:156] = f"{sum(data[:512]):06o}\0 ".encode()
    recording = open_recording(written(tmp_path / "v7.bag", data))
    assert [s.kind for s in recording.sensors] == ["camera"] and recording.format == "folder"
    recording.close()
