"""Small whole recordings of every format, to be damaged: some kilobytes each, a LiDAR and a camera."""

import io
import tarfile
import zipfile

import numpy as np
from making_packets import captured, packets, write_pcap, write_pcapng
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
from pypcd4 import Encoding, PointCloud
from rosbags.rosbag1 import Writer as BagWriter

_PCD_FIELDS = {"x": np.float32, "y": np.float32, "z": np.float32, "intensity": np.float32, "ring": np.uint16}


def few(columns=20):
    return scene(rings=16, columns=columns)


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
    for sensor, mode in (("vlp16", 0x37), ("hdl32e", 0x39)):
        yield write_pcap(folder / sensor, captured(packets(sensor, 2.2, mode=mode))).read_bytes()


def pcapng(folder):
    yield write_pcapng(folder / "a", captured(packets("vlp16", 2.2))).read_bytes()


def pcd(encoding):
    columns = [few()[name].astype(form) for name, form in _PCD_FIELDS.items()]
    buffer = io.BytesIO()
    PointCloud.from_points(columns, list(_PCD_FIELDS), list(_PCD_FIELDS.values())).save(buffer, encoding)
    return buffer.getvalue()


def members():
    """A folder of clouds and images, by path."""
    files = {"timestamps.csv": b"file,stamp_ns\n"}
    for number, encoding in enumerate((Encoding.ASCII, Encoding.BINARY, Encoding.BINARY_COMPRESSED)):
        files[f"clouds/{number}.pcd"] = pcd(encoding)
        files[f"images/{number}.png"] = png(8, 6, number)
    files["images/3.jpg"] = jpeg_claiming(8, 6)
    rows = [f"{name},{START_NS + i * PERIOD_NS}" for i, name in enumerate(n for n in files if "/" in n)]
    files["timestamps.csv"] += "\n".join(rows).encode()
    return files


def tar_of(files, mode="w"):
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode=mode) as archive:
        for name, data in files.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            archive.addfile(entry, io.BytesIO(data))
    return buffer.getvalue()


def zip_of(files, method=zipfile.ZIP_DEFLATED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data, method)
    return buffer.getvalue()


def tar(folder):
    yield tar_of(members())


# Where the bytes of a whole file are packed or checked, damage ends at the checksum; so one member of a folder
# is damaged and packed again. (what packs them, the folder)
REPACKED = {"member": (tar_of, members)}
SEEDS = {"rosbag1": rosbag1, "rosbag1 packed": rosbag1_packed, "pcap": pcap, "pcapng": pcapng, "tar": tar}
