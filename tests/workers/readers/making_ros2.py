"""ROS 2 bags and MCAP files made for tests, with rosbags and mcap as drivers and recorders write them."""

import base64
import json
import struct

import numpy as np
from making_recordings import (
    CLOUD,
    COMPRESSED,
    IMAGE,
    PERIOD_NS,
    START_NS,
    cloud,
    compressed,
    layout,
    png,
    raw_image,
    scene,
)
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

TYPES = get_typestore(Stores.ROS2_HUMBLE)
INFO = "sensor_msgs/msg/CameraInfo"
SCAN = "velodyne_msgs/msg/VelodyneScan"
TYPES.register(
    get_types_from_msg(
        "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n"
        + "=" * 80
        + "\nMSG: velodyne_msgs/VelodynePacket\nbuiltin_interfaces/Time stamp\nuint8[1206] data\n",
        SCAN,
    )
)
K = [1176.9, 0.0, 962.3, 0.0, 1177.7, 612.7, 0.0, 0.0, 1.0]
# foxglove.PackedElementField.NumericType of NumPy's formats
FOXGLOVE_TYPES = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}
FIELDS = {"x": "f4", "y": "f4", "z": "f4", "intensity": "u1", "ring": "u2", "time": "f8"}


def _time(stamp_ns):
    return TYPES.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))


def header(stamp_ns, frame_id):
    return TYPES.types["std_msgs/msg/Header"](_time(stamp_ns), frame_id)


def convert(message, kind):
    """A ROS 1 message of the same type as one of ROS 2."""
    values = {name: getattr(message, name) for name in message.__dataclass_fields__ if name != "__msgtype__"}
    stamp = message.header.stamp
    values["header"] = header(stamp.sec * 1_000_000_000 + stamp.nanosec, message.header.frame_id)
    if "fields" in values:
        field = TYPES.types["sensor_msgs/msg/PointField"]
        values["fields"] = [field(f.name, f.offset, f.datatype, f.count) for f in values["fields"]]
    return TYPES.types[kind](**values)


def info(stamp_ns, model="plumb_bob", d=(0.1, -0.2, 0.001, 0.002, 0.05), k=K, frame_id="camera"):
    roi = TYPES.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return TYPES.types[INFO](
        *(header(stamp_ns, frame_id), 1208, 1920, model, np.array(d, float), np.array(k, float)),
        *(np.eye(3).reshape(-1), np.zeros(12), 0, 0, roi),
    )


def scan(stamp_ns, packets):
    packet = TYPES.types["velodyne_msgs/msg/VelodynePacket"]
    messages = [packet(_time(moment), np.frombuffer(data, np.uint8)) for moment, data in packets]
    return TYPES.types[SCAN](header(stamp_ns, "velodyne"), messages)


def rig(count=5, raw=False):
    """(topic, type, time, message) of a LiDAR, a camera and its intrinsics."""
    for i in range(count):
        stamp = START_NS + i * PERIOD_NS
        yield "/points", CLOUD, stamp, convert(cloud(stamp, scene()), CLOUD)
        stamp += 12_000_000
        yield "/front/camera_info", INFO, stamp, info(stamp)
        if raw:
            pixels = np.full((6, 8, 3), i, np.uint8)
            yield "/front/image_raw", IMAGE, stamp, convert(raw_image(stamp, pixels, "bgr8"), IMAGE)
        else:
            image = convert(compressed(stamp, png(8, 6, i)), COMPRESSED)
            yield "/front/image_raw/compressed", COMPRESSED, stamp, image


def write_ros2(path, messages, storage="sqlite3", compress=None):
    """A ROS 2 bag's folder."""
    plugin = StoragePlugin.SQLITE3 if storage == "sqlite3" else StoragePlugin.MCAP
    writer = Writer(path, version=9, storage_plugin=plugin)
    if compress is not None:
        writer.set_compression(CompressionMode[compress], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, kind, log_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connections[topic], log_ns, TYPES.serialize_cdr(message, kind))
    return path


def write_mcap(path, messages, *, compression=CompressionType.ZSTD, chunked=True, summary=True, chunk_size=40_000):
    """An MCAP file of (topic, schema name, encoding, log time, bytes)."""
    with path.open("wb") as file:
        how = (
            {} if summary else {"index_types": IndexType.NONE, "use_statistics": False, "use_summary_offsets": False}
        )
        how |= {} if summary else {"repeat_channels": False, "repeat_schemas": False}
        writer = McapWriter(file, chunk_size=chunk_size, compression=compression, use_chunking=chunked, **how)
        writer.start()
        channels = {}
        for topic, schema, encoding, log_ns, data in messages:
            if topic not in channels:
                kind = {"cdr": "ros2msg", "json": "jsonschema", "ros1": "ros1msg"}.get(encoding, encoding)
                channels[topic] = writer.register_channel(topic, encoding, writer.register_schema(schema, kind, b""))
            writer.add_message(channels[topic], log_ns, data, log_ns)
        writer.finish()
    return path


def as_cdr(messages):
    for topic, kind, log_ns, message in messages:
        yield topic, kind, "cdr", log_ns, bytes(TYPES.serialize_cdr(message, kind))


def _varint(value):
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def field(number, value):
    """A protobuf field: bytes, text, a double's list (packed), or a (kind, int) pair: ``v`` varint, ``f`` fixed32."""
    if isinstance(value, tuple):
        kind, integer = value
        if kind == "v":
            return _varint(number << 3) + _varint(integer)
        return _varint(number << 3 | 5) + struct.pack("<I", integer)
    if isinstance(value, list):
        value = struct.pack(f"<{len(value)}d", *value)
    data = value.encode() if isinstance(value, str) else bytes(value)
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _timestamp(stamp_ns):
    sec, nano = divmod(stamp_ns, 1_000_000_000)
    return field(1, ("v", sec)) + field(2, ("v", nano))


def foxglove(count=3, encoding="protobuf"):
    """(topic, schema, encoding, time, bytes) of a LiDAR, two cameras and their intrinsics, as Foxglove's types."""
    dtype = layout(FIELDS, gap=1, padding=3)
    points = np.zeros(16 * 90, dtype)
    for name, values in scene().items():
        points[name] = values
    elements = [(name, dtype.fields[name][1], FOXGLOVE_TYPES[form]) for name, form in FIELDS.items()]
    pixels = bytes(range(144))
    for i in range(count):
        stamp = START_NS + i * PERIOD_NS
        image = png(8, 6, i)
        if encoding == "protobuf":
            time = field(1, _timestamp(stamp))
            packed = b"".join(
                field(5, field(1, name) + field(2, ("f", at)) + field(3, ("v", kind))) for name, at, kind in elements
            )
            size = field(2, ("f", 8)) + field(3, ("f", 6))
            bodies = {
                "PointCloud": time
                + field(2, "velodyne")
                + field(3, b"")
                + field(4, ("f", dtype.itemsize))
                + packed
                + field(6, points.tobytes())
                + field(100, "an id of a newer schema"),
                "CompressedImage": time + field(4, "camera") + field(2, image) + field(3, "png"),
                "RawImage": time
                + field(7, "left")
                + size
                + field(4, "rgb8")
                + field(5, ("f", 24))
                + field(6, pixels),
                "CameraCalibration": time
                + field(9, "camera")
                + field(2, ("f", 1920))
                + field(3, ("f", 1208))
                + field(4, "kannala_brandt")
                + field(5, [0.1, 0.2, 0.3, 0.4])
                + field(6, K),
            }
        else:
            sec, nano = divmod(stamp, 1_000_000_000)
            time = {"timestamp": {"sec": sec, "nsec": nano}}
            fields = [{"name": name, "offset": at, "type": kind} for name, at, kind in elements]
            texts = {
                "PointCloud": {"frame_id": "velodyne", "point_stride": dtype.itemsize, "fields": fields}
                | {"data": base64.b64encode(points.tobytes()).decode(), "pose": {}},
                "CompressedImage": {"frame_id": "camera", "format": "png", "data": base64.b64encode(image).decode()},
                "RawImage": {"frame_id": "left", "width": 8, "height": 6, "step": 24, "encoding": "rgb8"}
                | {"data": base64.b64encode(pixels).decode()},
                "CameraCalibration": {"frame_id": "camera", "width": 1920, "height": 1208, "K": K}
                | {"distortion_model": "kannala_brandt", "D": [0.1, 0.2, 0.3, 0.4]},
            }
            bodies = {name: json.dumps(time | document).encode() for name, document in texts.items()}
        topics = {
            "PointCloud": "/lidar",
            "CompressedImage": "/front/image",
            "RawImage": "/left/image",
            "CameraCalibration": "/front/calibration",
        }
        for name, body in bodies.items():
            yield topics[name], f"foxglove.{name}", encoding, stamp, body
