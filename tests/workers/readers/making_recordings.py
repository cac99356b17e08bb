"""Small recordings made for tests, in the real formats."""

import struct
import zlib

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS1_NOETIC)
START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 100_000_000
FORMATS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}

CLOUD = "sensor_msgs/msg/PointCloud2"
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
PLAIN = {"x": "f4", "y": "f4", "z": "f4", "intensity": "f4", "ring": "u2", "time": "f4"}


def scene(rings=16, columns=90):
    """Columns of a sweep as a VLP-16's driver publishes it: clockwise, a firing of all rings at a time."""
    turn = np.repeat(np.arange(columns) / columns, rings)
    ring = np.tile(np.arange(rings), columns)
    azimuth = np.pi - 2 * np.pi * turn
    elevation = np.radians(-15 + 30 * ring / (rings - 1))
    distance = 5 + np.sin(3 * azimuth)
    return {
        "x": distance * np.cos(elevation) * np.cos(azimuth),
        "y": distance * np.cos(elevation) * np.sin(azimuth),
        "z": distance * np.sin(elevation),
        "intensity": ring * 3.0 + 1,
        "ring": ring,
        "time": turn * 0.1,
    }


def scattered(count=1440):
    """Columns of a cloud whose points lie at no rings."""
    points = np.random.default_rng(0).normal(0, 10, (count, 3))
    return {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2], "intensity": np.zeros(count)}


def layout(fields, *, padding=0, gap=0, big_endian=False):
    """Structured dtype with ``gap`` bytes before each field and ``padding`` bytes at the end of a point."""
    offsets, end = [], 0
    for form in fields.values():
        offsets.append(end + gap)
        end += gap + int(form[1])
    formats = [(">" if big_endian else "<") + form for form in fields.values()]
    return np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": end + padding})


def header(stamp_ns, frame_id, types=TYPES):
    """In the ROS whose types these are, as all messages here."""
    kind = types.types["std_msgs/msg/Header"]
    seq = {"seq": 0} if "seq" in kind.__dataclass_fields__ else {}
    time = types.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
    return kind(**seq, stamp=time, frame_id=frame_id)


def cloud(stamp_ns, columns, fields=PLAIN, *, height=1, row_padding=0, types=TYPES, **how):
    """A PointCloud2 of the given columns in the given field order and formats."""
    dtype = layout(fields, **how)
    points = np.zeros(len(columns["x"]), dtype)
    for name in fields:
        points[name] = columns[name]
    rows = points.view(np.uint8).reshape(height, -1)
    rows = np.pad(rows, ((0, 0), (0, row_padding)))
    field_type = types.types["sensor_msgs/msg/PointField"]
    return types.types[CLOUD](
        header=header(stamp_ns, "velodyne", types),
        height=height,
        width=len(points) // height,
        fields=[field_type(n, dtype.fields[n][1], FORMATS[f], 1) for n, f in fields.items()],
        is_bigendian=how.get("big_endian", False),
        point_step=dtype.itemsize,
        row_step=rows.shape[1],
        data=rows.reshape(-1).copy(),
        is_dense=True,
    )


def compressed(stamp_ns, data, types=TYPES):
    return types.types[COMPRESSED](header(stamp_ns, "camera", types), "png", np.frombuffer(data, np.uint8))


def raw_image(stamp_ns, pixels, encoding, *, step=None, types=TYPES):
    height, width = pixels.shape[:2]
    rows = pixels.reshape(height, -1)
    step = step or rows.shape[1]
    data = np.pad(rows, ((0, 0), (0, step - rows.shape[1]))).reshape(-1)
    return types.types[IMAGE](header(stamp_ns, "camera", types), height, width, encoding, 0, step, data)


def write_bag(path, messages, compression=None):
    """A ROS 1 bag of (topic, type, log time, message)."""
    writer = Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connections = {}
        for topic, kind, log_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connections[topic], log_ns, TYPES.serialize_ros1(message, kind))
    return path


def clouds(count=5, columns=None, **how):
    """(topic, type, time, message) of some sweeps."""
    for i in range(count):
        stamp = START_NS + i * PERIOD_NS
        yield "/points", CLOUD, stamp, cloud(stamp, columns or scene(), **how)


def images(count=5, topic="/camera/compressed", data=None):
    """(topic, type, time, message) of some PNG frames, 12 ms after the sweeps."""
    for i in range(count):
        stamp = START_NS + i * PERIOD_NS + 12_000_000
        yield topic, COMPRESSED, stamp, compressed(stamp, png(8, 6, i) if data is None else data)


def interleaved(*streams):
    return sorted((m for stream in streams for m in stream), key=lambda m: m[2])


def png(width, height, grey=0):
    """A real PNG of one grey."""
    return png_claiming(width, height, zlib.compress((b"\0" + bytes([grey]) * width) * height))


def png_claiming(width, height, packed=b""):
    """A PNG whose header claims a size, whatever its data hold."""

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    ihdr = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", ihdr) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def jpeg_claiming(width, height):
    """The first segments of a JPEG: APP0, a comment, and a frame header that claims a size."""
    app0 = b"\xff\xe0" + struct.pack(">H", 16) + b"JFIF\0" + bytes(9)
    comment = b"\xff\xfe" + struct.pack(">H", 6) + b"\xff\xc0ab"  # holds what looks like a frame header
    frame = b"\xff\xc0" + struct.pack(">HBHHB", 11, 8, height, width, 1) + b"\x01\x11\x00"
    return b"\xff\xd8" + app0 + comment + frame + b"\xff\xd9"
