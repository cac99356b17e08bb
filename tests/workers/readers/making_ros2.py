"""ROS 2 bags and MCAP files made for tests, with rosbags and mcap as drivers and recorders write them."""

import json

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.json_format import MessageToDict
from making_recordings import (
    CLOUD,
    COMPRESSED,
    IMAGE,
    PERIOD_NS,
    START_NS,
    cloud,
    compressed,
    header,
    layout,
    png,
    raw_image,
    scene,
)
from making_recordings import TYPES as ROS1_TYPES
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

TYPES = get_typestore(Stores.ROS2_HUMBLE)
INFO = "sensor_msgs/msg/CameraInfo"
SCAN = "velodyne_msgs/msg/VelodyneScan"
_SCAN_TEXT = (
    "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n"
    + "=" * 80
    + "\nMSG: velodyne_msgs/VelodynePacket\nbuiltin_interfaces/Time stamp\nuint8[1206] data\n"
)
for store in (TYPES, ROS1_TYPES):
    store.register(get_types_from_msg(_SCAN_TEXT, SCAN))
K = [1176.9, 0.0, 962.3, 0.0, 1177.7, 612.7, 0.0, 0.0, 1.0]
# foxglove.PackedElementField.NumericType of NumPy's formats
FOXGLOVE_TYPES = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}
FIELDS = {"x": "f4", "y": "f4", "z": "f4", "intensity": "u1", "ring": "u2", "time": "f8"}


def info(stamp_ns, model="plumb_bob", d=(0.1, -0.2, 0.001, 0.002, 0.05), k=K, frame_id="camera"):
    roi = TYPES.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return TYPES.types[INFO](
        *(header(stamp_ns, frame_id, TYPES), 1208, 1920, model, np.array(d, float), np.array(k, float)),
        *(np.eye(3).reshape(-1), np.zeros(12), 0, 0, roi),
    )


def scan(stamp_ns, packets, types=TYPES):
    """Packets as a driver sends them, in the ROS whose types these are."""
    time, packet = types.types["builtin_interfaces/msg/Time"], types.types["velodyne_msgs/msg/VelodynePacket"]
    messages = [packet(time(*divmod(at, 10**9)), np.frombuffer(data, np.uint8)) for at, data in packets]
    return types.types[SCAN](header(stamp_ns, "velodyne", types), messages)


def rig(count=5, raw=False, **lens):
    """(topic, type, time, message) of a LiDAR, a camera and its intrinsics."""
    for i in range(count):
        stamp = START_NS + i * PERIOD_NS
        yield "/points", CLOUD, stamp, cloud(stamp, scene(), types=TYPES)
        stamp += 12_000_000
        yield "/front/camera_info", INFO, stamp, info(stamp, **lens)
        if raw:
            pixels = np.full((6, 8, 3), i, np.uint8)
            yield "/front/image_raw", IMAGE, stamp, raw_image(stamp, pixels, "bgr8", types=TYPES)
        else:
            yield "/front/image_raw/compressed", COMPRESSED, stamp, compressed(stamp, png(8, 6, i), TYPES)


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
        parts = ("use_statistics", "use_summary_offsets", "repeat_channels", "repeat_schemas")
        how = {} if summary else {"index_types": IndexType.NONE, **dict.fromkeys(parts, False)}
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


def foxglove(count=3, encoding="protobuf", frame_ns=0):
    """(topic, schema, encoding, time, bytes) of a LiDAR, two cameras and their intrinsics, as Foxglove's types."""
    dtype = layout(FIELDS, gap=1, padding=3)
    points = np.zeros(16 * 90, dtype)
    for name, values in scene().items():
        points[name] = values
    fields = [
        PackedElementField(name=n, offset=dtype.fields[n][1], type=FOXGLOVE_TYPES[f]) for n, f in FIELDS.items()
    ]
    lens = {"width": 1920, "height": 1208, "distortion_model": "kannala_brandt", "D": [0.1, 0.2, 0.3, 0.4], "K": K}
    pixels = {"width": 8, "height": 6, "encoding": "rgb8", "step": 24, "data": bytes(range(144))}
    for i in range(count):
        messages = {
            "/lidar": PointCloud(
                frame_id="velodyne", point_stride=dtype.itemsize, fields=fields, data=points.tobytes()
            ),
            "/front/image": CompressedImage(frame_id="camera", format="png", data=png(8, 6, i)),
            "/left/image": RawImage(frame_id="left", **pixels),
            "/front/calibration": CameraCalibration(frame_id="camera", **lens),
        }
        for topic, message in messages.items():
            stamp = START_NS + i * PERIOD_NS + (0 if topic == "/lidar" else frame_ns)
            message.timestamp.FromNanoseconds(stamp)
            if encoding == "protobuf":
                # A field of a newer schema, number 100, is passed over.
                body = message.SerializeToString() + b"\xa2\x06\x02id"
            else:
                document = MessageToDict(message, preserving_proto_field_name=True, use_integers_for_enums=True)
                sec, nsec = divmod(stamp, 1_000_000_000)
                body = json.dumps(document | {"timestamp": {"sec": sec, "nsec": nsec}}).encode()
            yield topic, message.DESCRIPTOR.full_name, encoding, stamp, body
