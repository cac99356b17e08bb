"""Foxglove's messages as ours: of the same fields, whether they came as protobuf, as JSON or as a ROS message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from workers.readers.clouds.pointcloud2 import PointCloud2, PointField
from workers.readers.ros.camera_info import camera_info, matrices_of
from workers.readers.ros.topic_messages import CloudMessage, EncodedImage, Message, RawImage, VideoMessage
from workers.readers.ros.video_codecs import codec_of_data

# foxglove.PackedElementField.NumericType to sensor_msgs/PointField's datatype: signed and unsigned are swapped.
_CLOUD_TYPES: Final = {1: 2, 2: 1, 3: 4, 4: 3, 5: 6, 6: 5, 7: 7, 8: 8}


def _head(message: Any) -> tuple[int, str]:
    time = message.timestamp
    parts = (time.sec, time.nanosec) if hasattr(time, "nanosec") else (time.seconds, time.nanos)
    return int(parts[0]) * 1_000_000_000 + int(parts[1]), str(message.frame_id)


def _cloud(message: Any) -> Message:
    """Its pose, which places the cloud in another frame, is not applied: points stay in the sensor's own."""
    fields = [PointField(str(f.name), int(f.offset), _CLOUD_TYPES.get(int(f.type), 0)) for f in message.fields]
    data, stride = np.frombuffer(message.data, np.uint8), int(message.point_stride)
    if len(data) and stride <= 0:
        raise ValueError("a cloud has points, and no stride")
    width = len(data) // max(1, stride)
    return CloudMessage(*_head(message), PointCloud2(1, width, fields, False, stride, width * stride, data))


def _compressed(message: Any) -> Message:
    data = bytes(message.data)
    codec = codec_of_data(data, str(message.format))
    return VideoMessage(*_head(message), codec, data) if codec else EncodedImage(*_head(message), data)


def _video(message: Any) -> Message:
    return VideoMessage(*_head(message), str(message.format), bytes(message.data))


def _raw(message: Any) -> Message:
    size = (int(message.width), int(message.height), int(message.step))
    data = np.frombuffer(message.data, np.uint8)
    return RawImage(*_head(message), *size, str(message.encoding), False, data)


def _calibration(message: Any) -> Message:
    size = (message.width, message.height)
    return camera_info(*_head(message), *size, message.distortion_model, *matrices_of(message))


FOXGLOVE_MESSAGES: Final[Mapping[str, Callable[[Any], Message]]] = {
    "PointCloud": _cloud,
    "CompressedImage": _compressed,
    "CompressedVideo": _video,
    "RawImage": _raw,
    "CameraCalibration": _calibration,
}
