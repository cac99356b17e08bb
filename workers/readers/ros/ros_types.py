"""ROS messages of LiDARs and cameras, deserialised by rosbags.

The types of ``sensor_msgs`` never change, so rosbags' own are taken and a file's definitions are not looked at. Those
of ``velodyne_msgs`` and ``foxglove_msgs`` are taken from the file where it carries them: the latter grow new fields.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from workers.readers.captures.velodyne.models import is_data_packet
from workers.readers.clouds.pointcloud2 import PointCloud2, PointField
from workers.readers.recording import ReadError
from workers.readers.ros.camera_info import camera_info, matrices_of
from workers.readers.ros.foxglove_messages import FOXGLOVE_MESSAGES
from workers.readers.ros.livox import LIVOX_CLOUDS, read_livox_cloud
from workers.readers.ros.topic_messages import (
    BagTopic,
    CameraInfo,
    CloudMessage,
    Decoder,
    EncodedImage,
    Message,
    PacketMessage,
    RawImage,
    VideoMessage,
)
from workers.readers.ros.video_codecs import codec_of_data

CLOUD: Final = "sensor_msgs/msg/PointCloud2"
IMAGE: Final = "sensor_msgs/msg/Image"
COMPRESSED: Final = "sensor_msgs/msg/CompressedImage"
INFO: Final = "sensor_msgs/msg/CameraInfo"
PACKETS: Final = "velodyne_msgs/msg/VelodyneScan"
# One packet a message, of the LiDAR or of its inertial unit, by the name of the driver's package.
OUSTER_PACKETS: Final = ("ouster_ros/msg/PacketMsg", "ouster_sensor_msgs/msg/PacketMsg")
FFMPEG: Final = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
TRANSFORM: Final = "tf2_msgs/msg/TFMessage"
TEXT: Final = "std_msgs/msg/String"
# By its name in ROS 2 and in ROS 1, and by that of tf before it.
TRANSFORMS: Final = (TRANSFORM, "tf/msg/tfMessage")

# Noetic's store has none of tf2.
_TRANSFORM_TEXT: Final = "geometry_msgs/TransformStamped[] transforms\n"
_STAMP: Final = "builtin_interfaces/Time timestamp\nstring frame_id\n"
_NEXT: Final = "=" * 80 + "\n"
# Of these the types come that never change; a file's own definitions of them are not looked at.
_STORES: Final = {"ros1": Stores.ROS1_NOETIC, "cdr": Stores.ROS2_HUMBLE}
# Used where a file carries no definition of its own.
_USUAL: Final[Mapping[str, str]] = {
    PACKETS: "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n"
    + _NEXT
    + "MSG: velodyne_msgs/VelodynePacket\nbuiltin_interfaces/Time stamp\nuint8[1206] data\n",
    **dict.fromkeys(OUSTER_PACKETS, "uint8[] buf\n"),
    FFMPEG: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
    "bool is_bigendian\nuint8[] data\n",
    "foxglove_msgs/msg/PointCloud": _STAMP
    + "geometry_msgs/Pose pose\nuint32 point_stride\nfoxglove_msgs/PackedElementField[] fields\nuint8[] data\n"
    + _NEXT
    + "MSG: foxglove_msgs/PackedElementField\nstring name\nuint32 offset\nuint8 type\n",
    "foxglove_msgs/msg/CompressedImage": _STAMP + "uint8[] data\nstring format\n",
    "foxglove_msgs/msg/CompressedVideo": _STAMP + "uint8[] data\nstring format\n",
    "foxglove_msgs/msg/RawImage": _STAMP
    + "uint32 width\nuint32 height\nstring encoding\nuint32 step\nuint8[] data\n",
    "foxglove_msgs/msg/CameraCalibration": _STAMP
    + "uint32 width\nuint32 height\nstring distortion_model\nfloat64[] d\n"
    "float64[9] k\nfloat64[9] r\nfloat64[12] p\n",
}


def full_name(name: str) -> str:
    """``sensor_msgs/msg/Image`` from ``sensor_msgs/Image``, which ROS 1 says."""
    package, _, kind = name.partition("/")
    return f"{package}/msg/{kind}" if kind and "/" not in kind else name


def ros_decoder(topic: BagTopic) -> Decoder | None:
    """Return the decoder of this topic's messages; None if they are of no LiDAR and no camera.

    Raises:
        ReadError: ``type_not_understood``, the file's own definition is not readable.
    """
    name = full_name(topic.type)
    if name in LIVOX_CLOUDS and topic.encoding in _STORES:
        return lambda raw: read_livox_cloud(raw, topic.encoding)
    read = _READERS.get(name)
    if read is None or topic.encoding not in _STORES:
        return None
    changes = name in _USUAL
    own = (name, topic.definition, topic.definition_format) if changes else ()
    types = _store(topic.encoding, *own)
    if topic.encoding == "ros1":
        return lambda raw: read(types.deserialize_ros1(raw, name))
    return lambda raw: read(types.deserialize_cdr(raw, name))


def fixed_types(encoding: str) -> Typestore:
    """The types that never change, for messages in ``ros1`` or ``cdr``."""
    return _store(encoding)


def message_reader(topic: BagTopic) -> Callable[[bytes], Any]:
    """Return the reader of messages of one of the fixed types, as rosbags has them."""
    kind = TRANSFORM if full_name(topic.type) in TRANSFORMS else full_name(topic.type)
    types = fixed_types(topic.encoding)
    read = types.deserialize_ros1 if topic.encoding == "ros1" else types.deserialize_cdr
    return lambda raw: read(raw, kind)


@lru_cache(maxsize=16)
def _store(encoding: str, name: str = "", definition: str = "", form: str = "") -> Typestore:
    """A type store that knows the fixed types and one more.

    Raises:
        ReadError: ``type_not_understood``.
    """
    types = get_typestore(_STORES[encoding])
    definitions = get_types_from_msg(_TRANSFORM_TEXT, TRANSFORM)
    definitions |= _own(name, definition, form) if name else {}
    types.register({kind: fields for kind, fields in definitions.items() if kind not in types.fielddefs})
    return types


def _own(name: str, definition: str, form: str) -> dict[str, Any]:
    if not definition.strip():
        return get_types_from_msg(_USUAL[name], name)
    try:
        if form in ("ros1msg", "ros2msg"):
            return get_types_from_msg(definition, name)
        definitions: dict[str, Any] = {}
        for part in definition.split(_NEXT):
            text = part.partition("\n")[2] if part.startswith("IDL: ") else part
            definitions |= get_types_from_idl(text) if text.strip() else {}
        return definitions
    except Exception as error:  # the parser's own classes, and whatever a strange text makes it stumble over
        raise ReadError(
            "type_not_understood",
            f"The file's definition of {name} cannot be read ({str(error)[:100]}).",
            "Record with the standard velodyne_msgs or foxglove_msgs packages.",
        ) from error


def _stamp(time: Any) -> int:
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def _head(message: Any) -> tuple[int, str]:
    return _stamp(message.header.stamp), str(message.header.frame_id)


def _read_cloud(message: Any) -> Message:
    fields = [PointField(f.name, f.offset, f.datatype, f.count) for f in message.fields]
    layout = (message.is_bigendian, message.point_step, message.row_step, message.data)
    return CloudMessage(*_head(message), PointCloud2(message.height, message.width, fields, *layout))


def _read_image(message: Any) -> Message:
    size = (int(message.width), int(message.height), int(message.step))
    return RawImage(*_head(message), *size, str(message.encoding), bool(message.is_bigendian), message.data)


def _read_compressed(message: Any) -> Message:
    data, form = message.data.tobytes(), str(message.format)
    codec = codec_of_data(data, form)
    return VideoMessage(*_head(message), codec, data) if codec else EncodedImage(*_head(message), data, _pixels(form))


def _pixels(form: str) -> str:
    """Return a compressed image's pixel format, by image_transport's ``bayer_rggb8; png compressed bayer_rggb8``."""
    first, _, target = form.partition(";")
    return (target.partition("compressed")[2].strip() or first.strip()).partition(" ")[0]


def _read_ffmpeg(message: Any) -> Message:
    size = (int(message.width), int(message.height))
    return VideoMessage(*_head(message), str(message.encoding), message.data.tobytes(), size)


def _read_info(message: Any) -> CameraInfo:
    size = (message.width, message.height)
    info = camera_info(*_head(message), *size, message.distortion_model, *matrices_of(message))
    roi = message.roi
    part = (int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height))
    return replace(info, binning=(int(message.binning_x), int(message.binning_y)), roi=part)


def _read_packets(message: Any) -> Message:
    stamp_ns, frame_id = _head(message)
    packets = ((_stamp(packet.stamp) or stamp_ns, packet.data.tobytes()) for packet in message.packets)
    return PacketMessage(stamp_ns, frame_id, [packet for packet in packets if is_data_packet(packet[1])], "Velodyne")


def _read_ouster_packet(message: Any) -> Message:
    return PacketMessage(0, "", [(0, message.buf.tobytes())], "Ouster")


_READERS: Final = {
    CLOUD: _read_cloud,
    IMAGE: _read_image,
    COMPRESSED: _read_compressed,
    FFMPEG: _read_ffmpeg,
    INFO: _read_info,
    PACKETS: _read_packets,
    **dict.fromkeys(OUSTER_PACKETS, _read_ouster_packet),
    **{f"foxglove_msgs/msg/{name}": read for name, read in FOXGLOVE_MESSAGES.items()},
}
