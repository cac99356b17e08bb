import bz2
import gzip
import io
import lzma
import os
import stat
import struct
import tarfile
import zipfile

import numpy as np
import pytest
import zstandard

from workers.readers import output
from workers.readers.recording import ReadError
from workers.readers.trees import file_tree, scratch
from workers.readers.trees.file_tree import Folder, read_file, read_head
from workers.readers.trees.open_tree import open_tree
from workers.readers.trees.zip_tree import Zip

FILES = {"2.png": b"two", "lidar/1.pcd": b"one" * 1000}
NOISE = np.random.default_rng(0).bytes(60_000)


def member(name, data=b"data", kind=tarfile.REGTYPE, link=""):
    info = tarfile.TarInfo(name)
    info.size, info.type, info.linkname = len(data) if kind == tarfile.REGTYPE else 0, kind, link
    return info, data


def tar_of(path, *members, mode="w"):
    with tarfile.open(path, mode) as archive:
        for info, data in members:
            archive.addfile(info, io.BytesIO(data))
    return path


def zip_of(path, members, packing=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", packing) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return path


def zip_entry(name, mode=stat.S_IFREG | 0o644):
    info = zipfile.ZipInfo(name)
    info.external_attr = mode << 16
    return info


def refused(make):
    with pytest.raises(ReadError) as caught:
        make()
    assert caught.value.hint
    return caught.value


def packed(kind, root, tmp_path):
    """The folder ``root`` packed in each way that is read."""
    path = tmp_path / f"a.{kind}"
    if kind.startswith("zip"):
        packings = {
            "zip": zipfile.ZIP_DEFLATED,
            "zip-stored": 0,
            "zip-bz2": zipfile.ZIP_BZIP2,
            "zip-xz": zipfile.ZIP_LZMA,
        }
        return zip_of(path, [(p, (root / p).read_bytes()) for p in (*FILES, ".hidden", "__MACOSX/x")], packings[kind])
    plain = tmp_path / "plain.tar"
    with tarfile.open(plain, "w") as archive:
        archive.add(root, ".")
    packers = {
        "tar": bytes,
        "tar.gz": gzip.compress,
        "tar.bz2": bz2.compress,
        "tar.xz": lzma.compress,
        "tar.zst": zstandard.ZstdCompressor().compress,
    }
    path.write_bytes(packers[kind](plain.read_bytes()))
    return path


@pytest.mark.parametrize(
    "kind",
    ["folder", "tar", "tar.gz", "tar.bz2", "tar.xz", "tar.zst", "zip", "zip-stored", "zip-bz2", "zip-xz"],
)
def test_a_folder_and_its_archives_hold_the_same(tmp_path, kind):
    root = tmp_path / "recording"
    for name, data in {**FILES, ".hidden": b"no", "__MACOSX/x": b"no"}.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(data)
    tree = open_tree(root if kind == "folder" else packed(kind, root, tmp_path))
    assert tree.paths == sorted(FILES)
    assert {path: read_file(tree, path) for path in tree.paths} == FILES
    assert {path: tree.size(path) for path in tree.paths} == {path: len(data) for path, data in FILES.items()}
    assert read_head(tree, "lidar/1.pcd", 4) == b"oneo"
    file, folder = tree.on_disk("2.png"), tree.on_disk("lidar")
    assert (file.read_bytes(), (folder / "1.pcd").read_bytes()) == (b"two", FILES["lidar/1.pcd"])
    tree.close()
    assert file.exists() == (kind == "folder")


def test_a_single_compressed_file_is_a_tree_of_one(tmp_path):
    (tmp_path / "walk.bag.gz").write_bytes(gzip.compress(b"#ROSBAG V2.0\n"))
    tree = open_tree(tmp_path / "walk.bag.gz")
    assert tree.paths == ["walk.bag"] and read_file(tree, "walk.bag") == b"#ROSBAG V2.0\n"
    assert tree.on_disk("walk.bag").name == "walk.bag"
    tree.close()


@pytest.mark.parametrize(
    "bad",
    [
        member("../evil.png"),
        member("/etc/evil.png"),
        member("a/../../evil.png"),
        member("..\\evil.png"),
        member("C:\\evil.png"),
        member("a.png", kind=tarfile.SYMTYPE, link="/etc/passwd"),
        member("a.png", kind=tarfile.LNKTYPE, link="b.png"),
        member("a.png", kind=tarfile.FIFOTYPE),
        member("a.png", kind=tarfile.CHRTYPE),
        member("fine.png"),
        member("fine.png/below.png"),
        member("long/" + "x" * 300),
    ],
    ids=lambda bad: bad[0].name[:20],
)
@pytest.mark.parametrize("mode", ["w", "w:gz"])
def test_tars_with_paths_that_climb_and_files_that_are_none(tmp_path, bad, mode):
    path = tar_of(tmp_path / "a.tar", member("fine.png"), bad, mode=mode)
    assert refused(lambda: open_tree(path)).code == "folder_refused"


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    "name",
    [
        zip_entry("../evil.png"),
        zip_entry("/etc/evil.png"),
        zip_entry("a/../../evil.png"),
        zip_entry("..\\evil.png"),
        zip_entry("C:/evil.png"),
        zip_entry("link.png", stat.S_IFLNK | 0o777),
        zip_entry("pipe.png", stat.S_IFIFO | 0o644),
        zip_entry("fine.png"),
        zip_entry("fine.png/below.png"),
    ],
    ids=lambda info: info.filename,
)
def test_zips_with_paths_that_climb_and_files_that_are_none(tmp_path, name):
    path = zip_of(tmp_path / "a.zip", [("fine.png", b"fine"), (name, b"bad")])
    assert refused(lambda: open_tree(path)).code == "folder_refused"


def test_an_encrypted_zip(tmp_path):
    path = zip_of(tmp_path / "a.zip", [("a.png", b"data")])
    data = bytearray(path.read_bytes())
    for magic, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(magic) + place] |= 1
    path.write_bytes(data)
    error = refused(lambda: open_tree(path))
    assert error.code == "archive_encrypted" and "password" in error.hint


def test_a_zip_whose_files_overlap(tmp_path):
    """Many entries of a directory that share one compressed file unpack to far more than their own bytes."""
    path = zip_of(tmp_path / "a.zip", [("a.png", NOISE), ("b.png", NOISE)])
    data = bytearray(path.read_bytes())
    second = data.index(b"PK\x01\x02", data.index(b"PK\x01\x02") + 1)
    data[second + 42 : second + 46] = bytes(4)  # its file is where the first one's is
    first = data.index(b"PK\x01\x02")
    directory = bytes(data[first:second])
    extra = b"".join(directory.replace(b"a.png", b"%05d" % i) for i in range(3))
    tail = bytearray(data[data.rindex(b"PK\x05\x06") :])
    struct.pack_into("<HHI", tail, 8, 5, 5, len(data) - len(tail) - first + len(extra))
    path.write_bytes(bytes(data[: -len(tail)]) + extra + tail)
    assert "overlap" in refused(lambda: open_tree(path)).message


@pytest.mark.parametrize("kind", ["tar.gz", "tar.bz2", "tar.xz", "tar.zst", "zip"])
def test_archives_that_expand_without_end(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(scratch, "HARMLESS_BYTES", 1_000_000)
    monkeypatch.setattr(output, "_WRITTEN", output._Written(most=1_000_000))
    root = tmp_path / "recording"
    (root / "lidar").mkdir(parents=True)
    for name in (*FILES, ".hidden"):
        (root / name).write_bytes(bytes(2_000_000))
    (root / "__MACOSX").mkdir()
    (root / "__MACOSX" / "x").write_bytes(b"")
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr(scratch.tempfile, "tempdir", str(tmp_path / "scratch"))
    assert refused(lambda: open_tree(packed(kind, root, tmp_path))).code == "archive_expands"
    assert not list((tmp_path / "scratch").iterdir())


def test_a_zip_that_holds_more_than_it_says(tmp_path):
    path = zip_of(tmp_path / "a.zip", [("a.png", bytes(100_000))])
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, data.index(b"PK\x01\x02") + 24, 1000)
    path.write_bytes(data)
    tree = open_tree(path)
    error = refused(lambda: read_file(tree, "a.png"))
    tree.close()
    assert error.code == "recording_truncated" and "a.png" in error.message


def test_links_in_a_folder(tmp_path):
    (tmp_path / "a.png").symlink_to("/etc/passwd")
    assert "'a.png' is a link" in refused(lambda: Folder(tmp_path)).message


def test_a_pipe_in_a_folder(tmp_path):
    os.mkfifo(tmp_path / "a.png")
    assert "no ordinary file" in refused(lambda: Folder(tmp_path)).message


@pytest.mark.parametrize("part", [700, 1100, 1600, 2048, 2600])
def test_a_tar_cut_short_anywhere(tmp_path, part):
    path = tar_of(tmp_path / "a.tar", member("a.png", b"a" * 600), member("b.png", b"b" * 600))
    path.write_bytes(path.read_bytes()[:part])
    assert refused(lambda: open_tree(path)).code == "recording_truncated"


@pytest.mark.parametrize("kind", ["tar.gz", "tar.bz2", "tar.xz", "tar.zst", "zip"])
@pytest.mark.parametrize("part", [0.1, 0.6, 0.98])
def test_a_packed_archive_cut_short_anywhere(tmp_path, kind, part):
    root = tmp_path / "recording"
    (root / "lidar").mkdir(parents=True)
    for name in (*FILES, ".hidden"):
        (root / name).write_bytes(NOISE)
    (root / "__MACOSX").mkdir()
    (root / "__MACOSX" / "x").write_bytes(b"")
    path = packed(kind, root, tmp_path)
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])
    error = refused(lambda: open_tree(path))
    assert error.code == "recording_truncated" and path.name in error.message


def test_a_tar_with_a_broken_header_in_its_middle(tmp_path):
    path = tar_of(tmp_path / "a.tar", member("a.png", b"a" * 600), member("b.png", b"b" * 600))
    data = bytearray(path.read_bytes())
    data[1536 + 148] ^= 1  # checksum of the second header
    path.write_bytes(data)
    assert refused(lambda: open_tree(path)).code == "recording_truncated"


def test_a_zip_with_damaged_data(tmp_path):
    path = zip_of(tmp_path / "a.zip", [("a.png", NOISE), ("b.png", b"fine")])
    data = bytearray(path.read_bytes())
    data[5000] ^= 255
    path.write_bytes(data)
    tree = open_tree(path)
    assert refused(lambda: read_file(tree, "a.png")).code == "recording_truncated"
    assert read_file(tree, "b.png") == b"fine"
    tree.close()


def test_absurd_sizes(tmp_path, monkeypatch):
    monkeypatch.setattr(file_tree, "MAX_FILE_BYTES", 3)
    path = tar_of(tmp_path / "a.tar", member("a.png"))
    tree = open_tree(path)
    assert refused(lambda: read_file(tree, "a.png")).code == "folder_refused"
    tree.close()


@pytest.mark.parametrize("kind", ["tar", "zip", "folder"])
def test_absurd_counts(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(file_tree, "MAX_FILES", 2)
    path = tmp_path / "many"
    if kind == "tar":
        tar_of(path, *(member(f"{i}.png") for i in range(3)))
    elif kind == "zip":
        zip_of(path, [(f"{i}.png", b"") for i in range(3)])
    else:
        path.mkdir()
        for i in range(3):
            (path / f"{i}.png").touch()
    assert "more than 2 files" in refused(lambda: open_tree(path)).message


def test_an_absurd_directory_of_a_zip_is_refused_before_it_is_read(tmp_path):
    path = zip_of(tmp_path / "a.zip", [("a.png", b"data")])
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, data.rindex(b"PK\x05\x06") + 12, 2**31)
    path.write_bytes(data)
    assert "directory alone" in refused(lambda: open_tree(path)).message


def test_a_directory_is_refused_by_its_zip64_record_whatever_the_short_one_says(tmp_path):
    path = zip_of(tmp_path / "a.zip", [("a.png", b"data")])
    data = path.read_bytes()
    end = data.rindex(b"PK\x05\x06")
    record = struct.pack("<IQHHIIQQQQ", 0x06064B50, 44, 45, 45, 0, 0, 1, 1, 2**31, 0)
    locator = struct.pack("<IIQI", 0x07064B50, 0, end, 1)
    path.write_bytes(data[:end] + record + locator + data[end:])
    assert "directory alone takes 2147483648 bytes" in refused(lambda: open_tree(path)).message
    far = struct.pack("<IIQI", 0x07064B50, 0, 0, 1)  # the record stands where the locator says, at the beginning
    path.write_bytes(record + data[:end] + far + data[end:])
    with pytest.raises(ReadError, match="directory alone"):
        Zip(path)


@pytest.mark.parametrize("kind", [b"L", b"x"])
def test_a_tar_of_nothing_but_extension_headers(tmp_path, kind):
    text = b"30 mtime=1350244992.023960108\n" if kind == b"x" else b"a\0"
    info = tarfile.TarInfo("././@LongLink")
    info.type, info.size = kind, len(text)
    block = info.tobuf(tarfile.GNU_FORMAT) + text.ljust(512, b"\0")
    (tmp_path / "a.tar").write_bytes(block * 3000 + bytes(10_240))
    assert refused(lambda: open_tree(tmp_path / "a.tar")).code == "recording_truncated"


@pytest.mark.parametrize("name", [".gz", "..gz", "...gz"])
def test_a_compressed_file_whose_inner_name_is_no_name(tmp_path, name):
    (tmp_path / name).write_bytes(gzip.compress(b"#ROSBAG V2.0\n"))
    tree = open_tree(tmp_path / name)
    assert tree.paths == ["recording"] and read_file(tree, "recording") == b"#ROSBAG V2.0\n"
    tree.close()
