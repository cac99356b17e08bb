"""What is no recording, in one table: each is refused by its code, with its place, a reason and a hint."""

import sqlite3
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from formats import CLOUDS, csv, named, npy, pcd, ply, read, table, tar_of, zip_of
from making_bombs import repeated_index
from making_packets import captured, datagram, packets, write_pcap, write_pcapng
from making_recordings import (
    COMPRESSED,
    START_NS,
    clouds,
    compressed,
    images,
    jpeg_claiming,
    png,
    png_claiming,
    scattered,
    write_bag,
)
from making_ros2 import as_cdr, rig, write_mcap, write_ros2
from mcap.writer import CompressionType
from pypcd4 import Encoding

from workers.readers.clouds.fields import CloudFields
from workers.readers.images.still_images import image_frame
from workers.readers.recording import ReadError
from workers.readers.trees.cloud_files import is_cloud_table, read_cloud

MIB = 1024**2
PIXELS = np.random.default_rng(0).integers(0, 255, (6, 8, 3), np.uint8)
NOISE = np.random.default_rng(0).bytes(4096)
PACKED = pcd(Encoding.BINARY_COMPRESSED)
FIVE = "property double x\nproperty double y\nproperty double z\nproperty double intensity\nproperty double ring\n"


class Evil:
    def __reduce__(self):
        return (open, ("/tmp/apexcal-must-not-exist", "w"))


def header(form, count, properties=FIVE):
    return f"ply\nformat {form} 1.0\nelement vertex {count}\n{properties}end_header\n".encode()


CLOUD = "cloud_malformed"
SHAPE = b"(1440, 5), }          "
# File's name, content, code, reason.
OF_CLOUDS = [
    *(
        (name, data[: len(data) * 2 // 3], "cloud_", "")
        for name, data in CLOUDS.items()
        if name.endswith((".pcd", ".ply", ".npy"))
    ),
    ("1.npy", npy(np.array([Evil()], object), allow_pickle=True), CLOUD, "header cannot be read"),
    *(("1.npy", npy(array), CLOUD, "its shape") for array in (table()[:, :2], table()[0], np.float64(3))),
    *(("1.npy", npy(table()).replace(SHAPE, shape.ljust(22)), CLOUD, "") for shape in
      (b"(10**9, 5), }", b"(-10, 5), }", b"(9999999999999, 5), }")),
    ("1.npy", npy(table()).replace(b"'<f8'", b"'<Q9'"), CLOUD, "header cannot be read"),
    ("1.npy", b"\x93NUMPY\x01\x00\xff\xff" + b"(" * 3000, CLOUD, "header cannot be read"),
    ("1.npy", b"", "cloud_empty", "holds no points"),
    ("1.bin", NOISE, CLOUD, "beyond 2000 m"),
    ("1.bin", NOISE[:30], CLOUD, "3 to 8 values of 4 bytes"),
    ("1.csv", b"x,y,z\n1,2\n", CLOUD, "2 values for 3 names"),
    ("1.csv", b"x,y,z\n1,2,oops\n", CLOUD, "oops"),
    ("1.csv", b"x,y,z\n1,2,3\n1,2\n", CLOUD, "columns"),
    ("1.csv", b"x,y,z,x\n1,2,3,4\n", CLOUD, "twice"),
    ("1.csv", b"x,y,z\n\xff\xfe\n", CLOUD, "utf-8"),
    ("1.pcd", b"text", CLOUD, "no DATA line"),
    ("1.pcd", PACKED.replace(b"POINTS 1440", b"POINTS 999999999"), CLOUD, "claims 999999999 points"),
    ("1.pcd", PACKED.replace(b"DATA binary_compressed", b"NOTHING"), CLOUD, "no DATA line"),
    ("1.pcd", PACKED.replace(b"SIZE 4 4 4 4 2", b"SIZE 4 4 4 4 3"), CLOUD, ""),
    ("1.pcd", PACKED.replace(b"COUNT 1 1 1 1 1", b"COUNT 1 1 1 1 9999999"), CLOUD, "values"),
    ("1.pcd", PACKED.replace(b"POINTS 1440", b"POINTS 1000"), CLOUD, "unpacks to"),
    ("1.pcd", PACKED.replace(b"TYPE F F F F U", b"TYPE F F F F X"), CLOUD, ""),
    ("1.ply", b"ply\nformat ascii 1.0\n", CLOUD, "no header"),
    ("1.ply", header("binary_little_endian", 10**11), CLOUD, "no number of vertices"),
    ("1.ply", header("middle_endian", 3) + bytes(99), CLOUD, "states no format"),
    ("1.ply", header("ascii", 2) + b"1 2 3\n4 5 6\n", CLOUD, "3 values for 5 properties"),
    ("1.ply", header("ascii", 3) + b"1 2 3 4 5\n", "cloud_truncated", "1 of 3 points"),
    ("1.ply", header("ascii", 1) + b"a b c d e\n", CLOUD, "no PLY file of points"),
    ("1.ply", header("ascii", 1, f"{FIVE}property float x\n") + b"1 2 3 4 5 6\n", CLOUD, "a property twice"),
    ("1.ply", header("ascii", 1, FIVE[18:]) + b"1 2 3 4\n", CLOUD, "no x, y and z"),
    ("1.ply", ply("ascii").replace(b"element vertex", b"element face 1\nelement vertex"), CLOUD, "first element"),
    ("1.ply", header("ascii", 1, f"{FIVE}property list uchar int i\n"), CLOUD, "that is no number"),
]  # fmt: skip


def encoded(suffix, pixels=PIXELS, *flags):
    return cv2.imencode(suffix, pixels, flags)[1].tobytes()


def claiming(suffix, width, height):
    """An image whose header claims a size."""
    data = bytearray(encoded(suffix))
    if suffix == ".bmp":
        struct.pack_into("<ii", data, 18, width, height)
    elif suffix == ".ppm":
        data = data.replace(b"8 6", f"{width} {height}".encode())
    elif suffix == ".tif":
        (directory,) = struct.unpack_from("<I", data, 4)
        (count,) = struct.unpack_from("<H", data, directory)
        for entry in range(directory + 2, directory + 2 + 12 * count, 12):
            (tag,) = struct.unpack_from("<H", data, entry)
            if tag in (256, 257):
                struct.pack_into("<HII", data, entry + 2, 4, 1, width if tag == 256 else height)
    return bytes(data)


def exif(orientation, order):
    """A JPEG that viewers turn."""
    entries = [(0x10F, 2, 4, 0), (0x112, 3, 1, orientation)]
    directory = struct.pack(order + "H", 2) + b"".join(struct.pack(order + "HHIHxx", *one) for one in entries)
    segment = b"Exif\0\0" + (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8) + directory
    upright = jpeg_claiming(640, 480)
    return upright[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + upright[2:]


DEEP_PNG = bytearray(png_claiming(8, 6, b"no deflate"))
DEEP_PNG[24] = 16
BAD, HUGE = "image_damaged", "image_too_large"
OF_IMAGES = [
    *((claiming(s, 60_000, 60_000), HUGE, "60000 x 60000") for s in (".tif", ".bmp", ".ppm")),
    *((make(60_000, 60_000), HUGE, "60000 x 60000") for make in (png_claiming, jpeg_claiming)),
    *((claiming(s, 0, 5), BAD, "") for s in (".tif", ".bmp", ".ppm")),
    *((claiming(s, 12_000, 12_000), BAD, "cannot hold") for s in (".tif", ".bmp", ".ppm")),
    *((encoded(s)[:6], BAD, "") for s in (".tif", ".bmp", ".ppm")),
    (bytes(DEEP_PNG), BAD, ""),
    (png_claiming(14_000, 14_000, b"x" * 100), BAD, "cannot hold"),
    (png(4, 4)[:20], BAD, "cut short"),
    (png_claiming(0, 5), BAD, "cut short"),
    (jpeg_claiming(640, 480)[:30], BAD, "cut short"),
    (jpeg_claiming(640, 0), BAD, "cut short"),
    (b"\xff\xd8\xff\xe0\x00\x10" + bytes(60), BAD, "cut short"),
    (b"RIFF\0\0\0\0WEBPVP8X\0\0\0\0", BAD, "cut short"),
    (b"", "image_empty", "no bytes"),
    (b"GIF89a" + bytes(40), "image_unsupported", "47 49 46"),
    *((exif(6, order), "image_turned", "orientation (6)") for order in "<>"),
]


def written(write, *arguments, change=None):
    """A case whose file a writer makes, and that is then changed."""

    def make(path):
        write(path, *arguments)
        if change is not None:
            data = bytearray(path.read_bytes())
            change(data)
            path.write_bytes(data)

    return make


def content(data):
    return lambda path: path.write_bytes(data)


def sql(*statements):
    def make(path):
        with sqlite3.connect(path) as db:
            for statement in statements:
                db.execute(statement)
        db.close()

    return make


def put(form, offset, value):
    return lambda data: struct.pack_into(form, data, offset, value)


def chunk_size(size):
    return lambda data: struct.pack_into("<Q", data, data.index(b"zstd") - 16, size)


def values_of(number, stamp):
    return sql(
        "CREATE TABLE topics (id, name, type, serialization_format)",
        "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)",
        f"INSERT INTO topics VALUES ({number}, '/points', 'sensor_msgs/msg/PointCloud2', 'cdr')",
        f"INSERT INTO messages VALUES (1, {number}, {stamp}, x'00010000')",
    )


def nobody(messages):
    return [(*most, 2**63 + stamp, data) for *most, stamp, data in as_cdr(messages)]


def link(path):
    with write_pcap(path, [(START_NS, bytes(80))]).open("r+b") as file:
        file.seek(20)
        file.write(struct.pack("<I", 189))


NOT, DAMAGED = "not_a_recording", "recording_damaged"
# What it is, how it is written, code, reason.
OF_FILES = {
    "text": (content(b"This is no bag.\n" * 100), NOT, "a text file"),
    "text in another alphabet": (content("längere Zeile ".encode() * 100), NOT, "a text file"),
    "noise": (content(bytes([0, 1, 2, 255] * 100)), NOT, "no format that is known"),
    "an old bag": (content(b"#ROSBAG V1.2\n" + bytes(100)), NOT, "version 1.x"),
    **{
        what: (content(head + bytes(600)), NOT, what)
        for head, what in (
            *((b"7z\xbc\xaf\x27\x1c", "a 7z archive"), (b"Rar!\x1a\x07\x01\0", "a RAR archive")),
            *((b"# .PCD v.7\nVERSION", "a single point cloud"), (b"\xff\xd8\xff\xe0", "a single image")),
        )
    },
    "no bytes": (content(b""), "recording_empty", "no bytes"),
    "a few bytes": (content(b"#ROSBAG"), "recording_truncated", "7 bytes"),
    "no file": (lambda path: None, "recording_missing", "neither"),
    "another database": (sql("CREATE TABLE people (name TEXT)"), NOT, "SQLite"),
    **{
        f"a database with {number} and {stamp}": (values_of(number, stamp), DAMAGED, "contradict each other")
        for number, stamp in (("'one'", "5"), ("NULL", "5"), ("x'00ff'", "5"), ("1", "'noon'"))
    },
    **{
        f"an MCAP file of {len(rest)} bytes": (content(b"\x89MCAP0\r\n" + rest), "recording_empty", "without any")
        for rest in (b"", bytes(100), b"\1" + bytes(7))
    },
    "a chunk larger than it says": (
        written(lambda path: write_mcap(path, as_cdr(rig(1)), chunk_size=MIB), change=chunk_size(1000)),
        *(DAMAGED, "more than 1000 bytes"),
    ),
    "a chunk that says too much": (
        written(lambda path: write_mcap(path, as_cdr(rig(1)), chunk_size=MIB), change=chunk_size(1 << 40)),
        *(DAMAGED, "at most"),
    ),
    "a chunk with another checksum": (
        written(
            lambda path: write_mcap(path, as_cdr(rig(1)), compression=CompressionType.NONE, chunk_size=MIB),
            change=lambda data: data.__setitem__(2000, data[2000] ^ 1),
        ),
        *(DAMAGED, "checksum"),
    ),
    "a time past 2262": (lambda path: write_mcap(path, nobody(rig(2))), DAMAGED, "past the year 2262"),
    "a bag that was never closed": (
        written(write_bag, clouds(3), change=lambda data: put("<Q", data.index(b"index_pos=") + 10, 0)(data)),
        *("recording_not_indexed", "not closed"),
    ),
    "an index that says the same twice": (lambda path: repeated_index(path, 2), DAMAGED, "more than once"),
    "a bag without rings": (
        lambda path: write_bag(path, clouds(columns=scattered(), fields=dict.fromkeys("xyz", "f4"))),
        *("rings_not_separable", "/points"),
    ),
    "a bag with a huge image": (
        lambda path: write_bag(path, images(1, data=jpeg_claiming(60_000, 60_000))),
        *(HUGE, "/camera/compressed"),
    ),
    "a bag with no image": (
        lambda path: write_bag(path, [("/c", COMPRESSED, START_NS, compressed(START_NS, b"no image at all"))]),
        *("image_unsupported", "/c"),
    ),
    "a packet of 3 GB": (
        written(write_pcap, captured(packets()), change=put("<I", 32, 3_000_000_000)),
        *("capture_damaged", "claims"),
    ),
    "a block of 4 GB": (
        written(write_pcapng, captured(packets(turns=0.2)), change=put("<I", 32, 0xFFFFFFF0)),
        *("capture_damaged", "claims"),
    ),
    "an unknown link": (link, "capture_link_unsupported", "type 189"),
    "no Velodyne": (
        lambda path: write_pcap(path, [(START_NS, datagram(bytes(900), port=7777))] * 5),
        *("no_lidar_packets", "5 of 900 bytes from 192.168.1.201:7777"),
    ),
    "no packets": (lambda path: write_pcap(path, []), "recording_empty", "without packets"),
    "a return mode that is not read": (
        lambda path: write_pcap(path, captured(packets(turns=0.2, mode=0x3B))),
        *("return_mode_unsupported", "0x3b"),
    ),
    **{
        f"packets by {maker}": (
            lambda path, data=payload, port=port: write_pcap(path, [(START_NS, datagram(data, port=port))] * 5),
            *("lidar_packets_not_read", f"a LiDAR by {maker}"),
        )
        for maker, payload, port in (
            ("Ouster", bytes(6464), 7502),
            ("Hesai", b"\xee\xff\x06\x01" + bytes(1076), 2368),
            ("RoboSense", b"\x55\xaa\x05\x5a" + bytes(1244), 6699),
            ("Livox", bytes(1380), 56301),
        )
    },
    "a folder of notes": (content(zip_of({"notes.txt": b"windy"})), "folder_empty", "notes.txt"),
    "an archive in an archive": (
        content(zip_of({"inner.zip": zip_of({"a.png": png(4, 4)})})),
        *("folder_empty", "inner.zip"),
    ),
    "a folder with a huge image": (content(tar_of({"1.png": png_claiming(60_000, 60_000)})), HUGE, "1.png"),
    "a folder with no image": (content(tar_of({"1.jpg": b"text"})), "image_unsupported", "1.jpg"),
    "a folder with no cloud": (content(tar_of({"1.pcd": b"text"})), CLOUD, "1.pcd"),
    "a bag without its files": (
        lambda path: content(tar_of({"b/metadata.yaml": _metadata(path), "b/x.db3": b"SQLite format 3\0"}))(path),
        *("bag_incomplete", "metadata.yaml"),
    ),
    "metadata that are a list": (
        content(tar_of({"b/metadata.yaml": b"- just a list\n", "b/x.db3": b"SQLite format 3\0"})),
        *("bag_incomplete", "metadata.yaml"),
    ),
}


def _metadata(path):
    text = (write_ros2(path.with_name("source"), rig(1)) / "metadata.yaml").read_text()
    return text.replace("rosbag2_bagfile_information", "nothing").encode()


def refused(read_it, code, reason):
    with pytest.raises(ReadError) as caught:
        read_it()
    error = caught.value
    assert error.code.startswith(code) and reason in error.message and error.hint, (error.code, error.message)
    assert not any(word in error.message for word in ("Error", "Traceback", "NoneType")), error.message
    return error


@pytest.mark.parametrize(("name", "data", "code", "reason"), OF_CLOUDS)
def test_files_that_are_no_clouds(name, data, code, reason):
    assert f"a/{name}" in refused(lambda: read_cloud(data, f"a/{name}"), code, reason).message


@pytest.mark.parametrize(("data", "code", "reason"), OF_IMAGES)
def test_files_that_are_no_images(data, code, reason):
    assert "frame 7" in refused(lambda: image_frame(data, 1, "frame 7"), code, reason).message


@pytest.mark.parametrize("kind", OF_FILES)
def test_uploads_that_are_no_recordings(tmp_path, kind):
    make, code, reason = OF_FILES[kind]
    make(tmp_path / "walk.bag")
    error = refused(lambda: read(tmp_path / "walk.bag"), code, reason)
    # Its traceback still holds what was opened.
    assert error and (tmp_path / "walk.bag") not in {link.resolve() for link in Path("/proc/self/fd").iterdir()}


@pytest.mark.parametrize("head", [b"file,stamp_ns\n1.png,3\n", b"", b"x y z\n", b"\xff\xfe\0\0", b"frame,stamp_ns\n"])
def test_other_tables_are_no_clouds(head):
    assert not is_cloud_table(head)


@pytest.mark.parametrize(("name", "data"), [("1.csv", b"x,y,z\n"), ("1.npy", npy(table()[:0]))])
def test_a_cloud_of_no_points_is_one(name, data):
    assert len(read_cloud(data, name)["x"]) == 0


def test_columns_under_other_names_and_fields_that_are_no_numbers():
    head = ['"Points_m_XYZ:0"', '"Points_m_XYZ:1"', " z ", '"laser_id"', "Reflectance"]
    cloud = read_cloud(csv(head=head), "1.csv")
    fields = CloudFields.of(cloud, "1.csv")
    assert fields.xyz == ("Points_m_XYZ:0", "Points_m_XYZ:1", "z") and is_cloud_table(csv(head=head)[:1024])
    assert (fields.rings, fields.intensities) == (("laser_id",), ("Reflectance",))
    kinds = {"z": "<f4", "x": "<f8", "y": "<f4", "ring": "u1"}
    points = np.zeros((16, 90), [*kinds.items(), ("name", "S3"), ("normal", "<f4", 3)])
    for name in kinds:
        points[name] = named(kinds=kinds)[name].reshape(16, 90)
    cloud = read_cloud(npy(points), "1.npy")
    assert set(cloud) == {*kinds, "normal"} and CloudFields.of(cloud, "1.npy").others == ("normal",)
    np.testing.assert_array_equal(cloud["x"], named(kinds=kinds)["x"])
    head = b"VERSION 0.7\nFIELDS x y z _ ring\nSIZE 4 4 4 1 2\nTYPE F F F U U\nCOUNT 1 1 1 2 1\nWIDTH 1\nHEIGHT 1\n"
    body = np.array([1, 2, 3], "<f4").tobytes() + b"\0\0" + np.array([7], "<u2").tobytes()
    cloud = read_cloud(head + b"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 1\nDATA binary\n" + body, "a.pcd")
    assert list(cloud) == ["x", "y", "z", "ring"] and cloud["ring"].tolist() == [7]
    assert len(read_cloud(pcd(Encoding.ASCII).replace(b"\n", b" \r\n"), "a.pcd")["x"]) == 1440
