"""The table of formats: for each a writer of the same five sweeps and five frames."""

import bz2
import gzip
import io
import lzma
import tarfile
import zipfile
from typing import NamedTuple

import numpy as np
import zstandard
from making_recordings import PERIOD_NS, START_NS, clouds, images, interleaved, png, scene, write_bag
from making_recordings import TYPES as ROS1
from making_ros2 import as_cdr, foxglove, rig, write_mcap, write_ros2
from mcap.writer import CompressionType
from pypcd4 import Encoding, PointCloud
from rosbags.rosbag1 import Writer

from workers.readers.detect import open_recording
from workers.readers.recording import Frame, Sweep

COUNT = 5
FRAME_NS = 12_000_000  # a frame comes so long after its sweep
COLUMNS = ("x", "y", "z", "intensity", "ring")
FORMS = (np.float32, np.float32, np.float32, np.float32, np.uint16)


class Format(NamedTuple):
    """``write`` makes a recording at a path; ``cut``: what is read of a file cut in half, as a share of its messages.

    ``points``: how exactly its points are kept, metres; ``stamps``: whether its files state them.
    """

    write: object
    cut: float = 0.0
    points: float = 0.0


def rosbag1(compression=None):
    return lambda path: write_bag(path, interleaved(clouds(COUNT), images(COUNT)), compression)


def ros2(storage, compress=None, bare=False):
    def write(path):
        folder = write_ros2(path, rig(COUNT), storage, compress)
        return next(file for file in folder.iterdir() if file.name != "metadata.yaml") if bare else folder

    return write


def mcap(messages, **how):
    return lambda path: write_mcap(path, messages(), **how)


def ros1_messages():
    for topic, kind, log_ns, message in interleaved(clouds(COUNT), images(COUNT)):
        yield topic, kind.replace("/msg/", "/"), "ros1", log_ns, bytes(ROS1.serialize_ros1(message, kind))


def table(columns=None, names=COLUMNS):
    return np.column_stack([(columns or scene())[name] for name in names])


def pcd(encoding, columns=None):
    values = [(columns or scene())[name].astype(form) for name, form in zip(COLUMNS, FORMS, strict=True)]
    file = io.BytesIO()
    PointCloud.from_points(values, COLUMNS, FORMS).save(file, encoding)
    return file.getvalue()


def npy(array, **how):
    file = io.BytesIO()
    np.save(file, array, **how)
    return file.getvalue()


def named(columns=None, kinds=dict.fromkeys(COLUMNS, "<f4")):
    columns = columns or scene()
    points = np.zeros(len(columns["x"]), list(kinds.items()))
    for name in kinds:
        points[name] = columns[name]
    return points


def ply(form, columns=None):
    rows, order = table(columns), {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    lines = ["ply", f"format {form} 1.0", "comment made", f"element vertex {len(rows)}"]
    lines += [*(f"property double {name}" for name in COLUMNS), "end_header", ""]
    body = "\n".join(" ".join(map(repr, row)) for row in rows.tolist()).encode() + b"\n"
    return "\n".join(lines).encode() + (rows.astype(f"{order}f8").tobytes() if order else body)


def csv(columns=None, delimiter=",", head=COLUMNS):
    rows = [delimiter.join(head), *(delimiter.join(map(repr, row)) for row in table(columns).tolist())]
    return ("\ufeff" + "\r\n".join(rows) + "\r\n").encode()


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


CLOUDS = {
    **{f"{encoding.value}.pcd": pcd(encoding) for encoding in list(Encoding)[:3]},
    **{f"{form}.ply": ply(form) for form in ("ascii", "binary_little_endian", "binary_big_endian")},
    **{f"plain{form}{order}.npy": npy(np.asarray(table(), form, order)) for form in ("<f4", ">f8") for order in "CF"},
    "named.npy": npy(named()),
    **{
        f"{name}.csv": csv(delimiter=delimiter)
        for name, delimiter in (("comma", ","), ("semicolon", ";"), ("tab", "\t"))
    },
    "kitti.bin": table(names=COLUMNS[:4]).astype("<f4").tobytes(),
    "nuscenes.pcd.bin": table().astype("<f4").tobytes(),
}


def members(cloud="binary.pcd"):
    """Files of a folder, a cloud and an image each, by path: their times are in their names."""
    suffix = cloud.partition(".")[2]
    files = {f"walk/clouds/{START_NS + i * PERIOD_NS}.{suffix}": CLOUDS[cloud] for i in range(COUNT)}
    files |= {f"walk/images/{START_NS + i * PERIOD_NS + FRAME_NS}.png": png(8, 6, i) for i in range(COUNT)}
    return files


def folder_of(path, files):
    for name, data in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)
    return path


def packed(pack, files=None):
    def write(path):
        path.write_bytes(pack(files or members()))
        return path

    return write


PACKINGS = {
    "tar": tar_of,
    **{f"tar.{name}": lambda files, name=name: tar_of(files, f"w:{name}") for name in ("gz", "bz2", "xz")},
    "tar.zst": lambda files: zstandard.compress(tar_of(files)),
    "zip": zip_of,
    **{
        f"zip {method}": lambda files, method=method: zip_of(files, method)
        for method in (zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    },
}
SINGLE = {"gz": gzip.compress, "bz2": bz2.compress, "xz": lzma.compress, "zst": zstandard.compress}


def single(pack):
    """A bag packed by itself."""

    def write(path):
        path.write_bytes(pack(rosbag1()(path.with_suffix(".bag")).read_bytes()))
        return path

    return write


FORMATS = {
    **{f"rosbag1 {how and how.name}": Format(rosbag1(how)) for how in (None, *Writer.CompressionFormat)},
    **{f"db3 {how}": Format(ros2("sqlite3", how)) for how in (None, "MESSAGE", "FILE")},
    **{f"bare db3 {how}": Format(ros2("sqlite3", how, bare=True), 0.2) for how in (None, "MESSAGE")},
    **{f"mcap bag {how}": Format(ros2("mcap", how)) for how in (None, "STORAGE")},
    "bare mcap bag": Format(ros2("mcap", bare=True), 0.1),  # one chunk: all of it or nothing
    **{
        f"mcap {how.name}{' chunks' * chunked}{' index' * index}": Format(
            mcap(lambda: as_cdr(rig(COUNT)), compression=how, chunked=chunked, summary=index), 0.2
        )
        for how in CompressionType
        for chunked in ((True, False) if how is CompressionType.NONE else (True,))  # chunks alone are packed
        for index in (True, False)
    },
    "mcap ros1": Format(mcap(ros1_messages), 0.2),
    **{
        f"mcap {how}": Format(mcap(lambda how=how: foxglove(COUNT, how, FRAME_NS)), 0.2)
        for how in ("protobuf", "json")
    },
    **{f"folder {name}": Format(lambda path, n=name: folder_of(path, members(n)), points=1e-4) for name in CLOUDS},
    **{name: Format(packed(pack), points=1e-4) for name, pack in PACKINGS.items()},
    **{f"bag.{name}": Format(single(pack)) for name, pack in SINGLE.items()},
}


def read(path, options=None):
    """The recording, closed; its messages in the order in which they come; and its warnings.

    Raises ReadError of a sensor of which nothing can be used.
    """
    recording = open_recording(path, options)
    try:
        pairs = list(recording.messages(recording.sensors))
        for sensor in recording.sensors:
            refusal = recording.omissions.refusal(sensor.name)
            if refusal and all(other is not sensor for other, _ in pairs):
                raise refusal
        return recording, [item for _, item in pairs], recording.warnings
    finally:
        recording.close()


def sweeps_of(items):
    return [item for item in items if isinstance(item, Sweep)]


def frames_of(items):
    return [item for item in items if isinstance(item, Frame)]


def same(item, other):
    """Whether two messages are the same to the byte."""
    if isinstance(item, Frame):
        return item == other
    return isinstance(other, Sweep) and item.stamp_ns == other.stamp_ns and item.xyz.tobytes() == other.xyz.tobytes()
