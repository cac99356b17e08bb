"""The contents of a message on a topic, whatever library or wire format it came through."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from workers.readers.captures.packet_source import FIELDS
from workers.readers.clouds.fields import Columns
from workers.readers.clouds.pointcloud2 import PointCloud2
from workers.readers.images.headers import read_image_header
from workers.readers.recording import ReadError, Sensor


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic of a bag or an MCAP file.

    Attributes:
        name: unique in the file; several connections or channels of one name and type are one topic.
        type: ``sensor_msgs/msg/PointCloud2`` or ``foxglove.PointCloud``.
        encoding: ``ros1``, ``cdr``, ``protobuf`` or ``json``, as the file says.
        definition: the type's definition as the file carries it, empty where it carries none.
        definition_format: ``ros1msg``, ``ros2msg``, ``ros2idl`` or another.
        count: number of messages where the file says it.
        qos: the quality of service that it was offered with, as the file says it; of ROS 2.
        type_hash: its type's hash, as the file says it; of ROS 2.
    """

    name: str
    type: str
    encoding: str
    definition: str
    definition_format: str
    count: int | None
    qos: str = ""
    type_hash: str = ""


@dataclass(frozen=True, slots=True)
class StampedMessage:
    """Stamp (nanoseconds, 0 where the message has none) and frame of a message."""

    stamp_ns: int
    frame_id: str


@dataclass(frozen=True, slots=True)
class CloudMessage(StampedMessage):
    """A point cloud: as the message lays it out, or its columns."""

    cloud: PointCloud2 | Columns


@dataclass(frozen=True, slots=True)
class EncodedImage(StampedMessage):
    """An image file. ``encoding``: the ROS name of what its pixels are, where the message says it, else empty."""

    data: bytes
    encoding: str = ""


@dataclass(frozen=True, slots=True)
class RawImage(StampedMessage):
    """Pixels as a camera's driver lays them out.

    Attributes:
        width, height: pixels.
        step: bytes from one row to the next.
        encoding: the ROS name of the pixel format.
        big_endian: of values of 16 bits.
        data: (step * height,) uint8, or longer.
    """

    width: int
    height: int
    step: int
    encoding: str
    big_endian: bool
    data: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class PacketMessage(StampedMessage):
    """Packets of a LiDAR by ``maker``, each with the host's stamp, 0 where the driver states none."""

    packets: Sequence[tuple[int, bytes]]
    maker: str


@dataclass(frozen=True, slots=True)
class VideoMessage(StampedMessage):
    """One encoded frame of a video. ``codec``: as the message names it; ``size``: width and height, 0: not stated."""

    codec: str
    data: bytes
    size: tuple[int, int] = (0, 0)


@dataclass(frozen=True, slots=True)
class CameraInfo(StampedMessage):
    """Intrinsics that somebody stated.

    Attributes:
        distortion_model: as the message says.
        d: distortion coefficients.
        k: 9 numbers, the camera matrix by rows.
        r: 9 numbers by rows, the rotation from the camera's frame to that of its rectified images.
        p: 12 numbers by rows, the projection matrix of its rectified images.
    """

    width: int
    height: int
    distortion_model: str
    d: Sequence[float]
    k: Sequence[float]
    r: Sequence[float] = ()
    p: Sequence[float] = ()
    binning: tuple[int, int] = (1, 1)
    roi: tuple[int, int, int, int] = (0, 0, 0, 0)


Message = CloudMessage | EncodedImage | RawImage | VideoMessage | PacketMessage | CameraInfo
Decoder = Callable[[bytes], Message]


def described(topic: BagTopic) -> str:
    """Name and type of a topic that is no sensor, and why it is not read where it could be one."""
    if topic.type.startswith("foxglove.") and topic.encoding not in ("protobuf", "json"):
        return f"{topic.name} ({topic.type} encoded as {topic.encoding or 'nothing'}, which is not read)"
    return f"{topic.name} ({topic.type})"


def topic_sensor(topic: BagTopic, first: Message | None) -> Sensor:
    """A topic as a sensor, with what its first message tells."""
    name, count = topic.name, topic.count
    frame_id = "" if first is None else first.frame_id
    if isinstance(first, PacketMessage):
        return Sensor("lidar", name, frame_id, count, {"type": topic.type, "fields": FIELDS, "model": first.maker})
    if isinstance(first, CloudMessage):
        cloud = first.cloud
        fields = " ".join([field.name for field in cloud.fields] if isinstance(cloud, PointCloud2) else cloud)
        return Sensor("lidar", name, frame_id, count, {"type": topic.type, "fields": fields})
    notes = {"type": topic.type}
    if isinstance(first, RawImage):
        notes |= {"width": str(first.width), "height": str(first.height)}
    elif isinstance(first, VideoMessage) and all(first.size):
        notes |= {"width": str(first.size[0]), "height": str(first.size[1])}
    elif isinstance(first, EncodedImage):
        try:
            header = read_image_header(first.data, name)
            notes |= {"width": str(header.width), "height": str(header.height)}
        except ReadError:  # said with its place when the frame is read
            pass
    kind = "lidar" if first is None and ("Cloud" in topic.type or "VelodyneScan" in topic.type) else "camera"
    return Sensor(kind, name, frame_id, count, notes)
