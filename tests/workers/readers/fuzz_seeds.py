"""Small whole recordings of every format, to be damaged: some kilobytes each, a LiDAR and a camera."""

import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import making_ouster as ouster
import numpy as np
import zstandard
from formats import csv, named, npy, pcd, ply, table, tar_of, zip_of
from making_packets import captured, datagram, packets, write_pcap, write_pcapng
from making_recordings import (
    IMAGE,
    PERIOD_NS,
    START_NS,
    clouds,
    images,
    interleaved,
    jpeg_claiming,
    png,
    raw_image,
    scene,
    write_bag,
)
from making_ros2 import SCAN, as_cdr, foxglove, scan, write_mcap, write_ros2
from making_ros2 import rig as ros2_rig
from making_videos import write_video
from mcap.writer import CompressionType
from pypcd4 import Encoding
from rosbags.rosbag1 import Writer as BagWriter

FEW = scene(rings=16, columns=20)


def _bag(folder, compression=None):
    pixels = np.arange(48, dtype=np.uint8).reshape(6, 8)
    stamps = [START_NS + i * PERIOD_NS for i in (0, 1)]
    raw = [("/raw", IMAGE, stamp, raw_image(stamp, pixels, "mono8")) for stamp in stamps]
    return write_bag(folder / "a.bag", interleaved(clouds(3), images(3), raw), compression).read_bytes()


def rosbag1(folder):
    yield _bag(folder)


def rosbag1_packed(folder):
    for number, compression in enumerate((BagWriter.CompressionFormat.LZ4, BagWriter.CompressionFormat.BZ2)):
        (folder / str(number)).mkdir()
        yield _bag(folder / str(number), compression)


def pcap(folder):
    for sensor, mode in (
        ("vlp16", 0x37),
        ("hdl32e", 0x39),
        ("vlp32c", 0x37),
        ("hdl64e", 0x37),
        ("alpha_prime", 0x38),
    ):
        yield write_pcap(folder / sensor, captured(packets(sensor, 1.4, mode=mode))).read_bytes()


def pcapng(folder):
    yield write_pcapng(folder / "a", captured(packets("vlp16", 1.4))).read_bytes()


def _images(count=2):
    return {f"images/{START_NS + i * PERIOD_NS}.png": png(8, 6, i) for i in range(count)}


def _clouds(suffix, contents):
    return {f"clouds/{START_NS + i * PERIOD_NS}.{suffix}": data for i, data in enumerate(contents)} | _images()


def members():
    """A folder of clouds and images with a table of times, by path."""
    files = {}
    for number, encoding in enumerate(list(Encoding)[:3]):
        files[f"clouds/{number}.pcd"] = pcd(encoding, FEW)
        files[f"images/{number}.png"] = png(8, 6, number)
    files["images/3.jpg"] = jpeg_claiming(8, 6)
    rows = [f"{name},{START_NS + i * PERIOD_NS}" for i, name in enumerate(files)]
    return {"timestamps.csv": "\n".join(["file,stamp_ns", *rows]).encode()} | files


def ply_members():
    """Clouds as PLY in every form; times in the names."""
    return _clouds("ply", (ply(form, FEW) for form in ("binary_little_endian", "binary_big_endian", "ascii")))


def array_members():
    """Clouds as arrays, plain and with named columns."""
    return _clouds("npy", (npy(table(FEW).astype(np.float32)), npy(named(FEW))))


def table_members():
    """Clouds as text."""
    return _clouds("csv", [csv(FEW)] * 2)


def tar(folder):
    yield tar_of(members())


def archives(folder):
    """The folder in every way of packing it."""
    yield zip_of(members())
    yield zip_of(members(), zipfile.ZIP_STORED)
    yield from (tar_of(members(), f"w:{packing}") for packing in ("gz", "bz2", "xz"))
    yield zstandard.compress(tar_of(members()))


def kitti_members():
    """KITTI's raw layout."""
    moments = [f"2011-09-26 13:02:25.{64389445 + i * 103000000:09d}" for i in range(3)]
    cloud = table(scene(columns=60), ("x", "y", "z", "intensity")).astype("<f4").tobytes()
    files = {f"drive/velodyne_points/data/{i:010d}.bin": cloud for i in range(3)}
    files |= {f"drive/image_02/data/{i:010d}.png": png(8, 6, i) for i in range(3)}
    files |= {
        f"drive/{sensor}/timestamps.txt": "\n".join(moments).encode() for sensor in ("velodyne_points", "image_02")
    }
    return files


def mcap(folder):
    """Bare files of ROS 2, packed and plain, with and without an index; and of Foxglove's own types."""
    for number, compression in enumerate((CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4)):
        whole = write_mcap(folder / str(number), as_cdr(ros2_rig(2)), compression=compression, summary=number != 1)
        yield whole.read_bytes()
    for encoding in ("protobuf", "json"):
        path = folder / encoding
        yield write_mcap(path, foxglove(2, encoding), compression=CompressionType.NONE, chunked=False).read_bytes()


def db3(folder):
    yield next(write_ros2(folder / "bag", ros2_rig(2)).glob("*.db3")).read_bytes()
    scans = [("/packets", SCAN, START_NS, scan(START_NS, list(packets("vlp16", 1.1))))]
    yield next(write_ros2(folder / "scans", scans).glob("*.db3")).read_bytes()


def ros2_members():
    """A ROS 2 bag with its description."""
    if "folder" not in BAGS:
        with TemporaryDirectory() as folder:
            bag = write_ros2(Path(folder) / "bag", ros2_rig(2), "sqlite3", "MESSAGE")
            BAGS["folder"] = {f"bag/{file.name}": file.read_bytes() for file in bag.iterdir()}
    return BAGS["folder"]


BAGS: dict[str, dict[str, bytes]] = {}


def video(folder):
    """A video of each kind, alone: it is refused for want of a LiDAR, after it was opened."""
    for suffix in ("mp4", "avi", "mkv"):
        codec = "mpeg4" if suffix == "avi" else "libx264"
        yield write_video(folder / f"v.{suffix}", codec=codec, times_ms=(0, 67, 133)).read_bytes()


def bombs(folder):
    """Files that were made to keep a reader busy, or to fill its disk."""
    from making_bombs import BOMBS  # it makes them of what is here

    for name, build in BOMBS.items():
        yield build(folder / name).read_bytes()


def video_members():
    """A capture with a video beside it."""
    return {
        "lidar.bag": WHOLE["rosbag1"][0],
        "camera.mp4": WHOLE["video"][0],
        "camera.csv": b"stamp_ns\n" + b"\n".join(str(START_NS + i * PERIOD_NS).encode() for i in range(3)),
    }


def ouster_members():
    """A capture of an Ouster's packets, what it says of itself, and images."""
    with TemporaryDirectory() as folder:
        frames = [(at, datagram(data, port=7502)) for at, data in ouster.packets("RNG15_RFL8_NIR8", 1.2, rows=16)]
        capture = write_pcap(Path(folder) / "a.pcap", frames).read_bytes()
    return {"a.pcap": capture, "a.json": ouster.metadata("RNG15_RFL8_NIR8", rows=16)} | _images()


# Where the bytes of a whole file are packed or checked, damage ends at the checksum; so one member of a folder
# is damaged and packed again. (what packs them, the folder)
REPACKED = {
    "clouds and images": (tar_of, members),
    "KITTI": (tar_of, kitti_members),
    "ROS 2 folder": (tar_of, ros2_members),
    "arrays": (tar_of, array_members),
    "tables": (tar_of, table_members),
    "PLY": (tar_of, ply_members),
    "bag and video": (tar_of, video_members),
    "Ouster": (tar_of, ouster_members),
}
SEEDS = {
    "rosbag1": rosbag1,
    "rosbag1 packed": rosbag1_packed,
    "pcap": pcap,
    "pcapng": pcapng,
    "mcap": mcap,
    "db3": db3,
    "tar": tar,
    "archives": archives,
    "video": video,
    "bombs": bombs,
}
WHOLE: dict[str, list[bytes]] = {}


def make_whole(folder):
    """Every seed, made once."""
    for name, build in SEEDS.items():
        if name not in WHOLE:
            (folder / name.replace(" ", "_")).mkdir()
            WHOLE[name] = list(build(folder / name.replace(" ", "_")))
    return WHOLE
