"""Foxglove's own messages: point clouds, images, video and calibrations, in protobuf or JSON."""

from __future__ import annotations

import base64
import binascii
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from workers.readers.ros.camera_info import camera_info
from workers.readers.ros.protobuf_wire import Fields, WireError, doubles, fields_of, last, number, text
from workers.readers.ros.topic_messages import (
    CloudMessage,
    Decoder,
    EncodedImage,
    Message,
    RawImage,
    Topic,
    VideoMessage,
)

# foxglove.PackedElementField.NumericType to sensor_msgs/PointField's datatype: signed and unsigned are swapped.
FOXGLOVE_CLOUD_TYPES: Final = {1: 2, 2: 1, 3: 4, 4: 3, 5: 6, 6: 5, 7: 7, 8: 8}
_NAMES: Final = ("PointCloud", "CompressedImage", "CompressedVideo", "RawImage", "CameraCalibration")


@dataclass(frozen=True, slots=True)
class CloudField:
    """``sensor_msgs/PointField``."""

    name: str
    offset: int
    datatype: int
    count: int = 1


@dataclass(frozen=True, slots=True)
class FoxgloveCloud:
    """A ``foxglove.PointCloud`` in the shape of ``sensor_msgs/PointCloud2``.

    Its pose, which places the cloud in another frame, is not applied: points stay in the sensor's own.
    """

    width: int
    fields: Sequence[CloudField]
    point_step: int
    row_step: int
    data: NDArray[np.uint8]
    height: int = 1
    is_bigendian: bool = False

    @classmethod
    def of(cls, fields: Sequence[tuple[str, int, int]], stride: int, data: NDArray[np.uint8]) -> FoxgloveCloud:
        """From (name, offset, PointField datatype) of each field."""
        width = len(data) // stride if stride > 0 else 0
        return cls(width, [CloudField(*field) for field in fields], stride, width * stride, data)


def foxglove_decoder(topic: Topic) -> Decoder | None:
    """How messages of this topic are read, None where they are none of these types, or in another encoding."""
    package, _, name = topic.type.rpartition(".")
    if package != "foxglove" or name not in _NAMES:
        return None
    if topic.encoding == "protobuf":
        return _PROTOBUF[name]
    return _JSON[name] if topic.encoding == "json" else None


# The numbers below are those of the fields in foxglove-sdk's schemas (.proto); new fields come with new numbers.
def _time(fields: Fields) -> int:
    inner = last(fields, 1)
    if not isinstance(inner, bytes | memoryview):
        return 0
    parts = fields_of(inner)
    return number(parts, 1) * 1_000_000_000 + number(parts, 2)


def _payload(fields: Fields, key: int) -> memoryview:
    value = last(fields, key)
    return value if isinstance(value, memoryview) else memoryview(b"")


def _protobuf_cloud(raw: bytes) -> Message:
    fields = fields_of(raw)
    columns: list[tuple[str, int, int]] = []
    for inner in fields.get(5, ()):
        if not isinstance(inner, memoryview):
            raise WireError("a field of the cloud is no message")
        part = fields_of(inner)
        columns.append((text(part, 1), number(part, 2), FOXGLOVE_CLOUD_TYPES.get(number(part, 3), 0)))
    data = np.frombuffer(_payload(fields, 6), np.uint8)
    return CloudMessage(_time(fields), text(fields, 2), FoxgloveCloud.of(columns, number(fields, 4), data))


def _protobuf_compressed(raw: bytes) -> Message:
    fields = fields_of(raw)
    return EncodedImage(_time(fields), text(fields, 4), bytes(_payload(fields, 2)))


def _protobuf_video(raw: bytes) -> Message:
    fields = fields_of(raw)
    return VideoMessage(_time(fields), text(fields, 2), text(fields, 4), bytes(_payload(fields, 3)))


def _protobuf_raw(raw: bytes) -> Message:
    fields = fields_of(raw)
    size = (number(fields, 2), number(fields, 3), number(fields, 5))
    data = np.frombuffer(_payload(fields, 6), np.uint8)
    return RawImage(_time(fields), text(fields, 7), *size, text(fields, 4), False, data)


def _protobuf_calibration(raw: bytes) -> Message:
    fields = fields_of(raw)
    size = (number(fields, 2), number(fields, 3))
    matrices = (doubles(fields, place) for place in (5, 6, 7, 8))
    return camera_info(_time(fields), text(fields, 9), *size, text(fields, 4), *matrices)


_PROTOBUF: Final[dict[str, Callable[[bytes], Message]]] = {
    "PointCloud": _protobuf_cloud,
    "CompressedImage": _protobuf_compressed,
    "CompressedVideo": _protobuf_video,
    "RawImage": _protobuf_raw,
    "CameraCalibration": _protobuf_calibration,
}


def _document(raw: bytes) -> tuple[dict[str, Any], int, str]:
    """A JSON message with its stamp and frame.

    Raises:
        WireError: it is no JSON object.
    """
    message: Any = json.loads(raw)
    if not isinstance(message, dict):
        raise WireError("a message is no JSON object")
    message = cast(dict[str, Any], message)
    time: dict[str, Any] = message.get("timestamp") or {}
    stamp_ns = int(time.get("sec", 0)) * 1_000_000_000 + int(time.get("nsec", 0))
    return message, stamp_ns, str(message.get("frame_id", ""))


def _base64(value: Any) -> bytes:
    try:
        return base64.b64decode(value, validate=True)
    except (binascii.Error, TypeError) as error:
        raise WireError("data is not in base64") from error


def _json_cloud(raw: bytes) -> Message:
    message, stamp_ns, frame_id = _document(raw)
    columns = [
        (str(f["name"]), int(f["offset"]), FOXGLOVE_CLOUD_TYPES.get(int(f["type"]), 0)) for f in message["fields"]
    ]
    data = np.frombuffer(_base64(message["data"]), np.uint8)
    return CloudMessage(stamp_ns, frame_id, FoxgloveCloud.of(columns, int(message["point_stride"]), data))


def _json_compressed(raw: bytes) -> Message:
    message, stamp_ns, frame_id = _document(raw)
    return EncodedImage(stamp_ns, frame_id, _base64(message["data"]))


def _json_video(raw: bytes) -> Message:
    message, stamp_ns, frame_id = _document(raw)
    return VideoMessage(stamp_ns, frame_id, str(message["format"]), _base64(message["data"]))


def _json_raw(raw: bytes) -> Message:
    message, stamp_ns, frame_id = _document(raw)
    size = (int(message["width"]), int(message["height"]), int(message["step"]))
    data = np.frombuffer(_base64(message["data"]), np.uint8)
    return RawImage(stamp_ns, frame_id, *size, str(message["encoding"]), False, data)


def _json_calibration(raw: bytes) -> Message:
    message, stamp_ns, frame_id = _document(raw)
    size = (int(message["width"]), int(message["height"]))
    matrices = (message.get(name, ()) for name in "DKRP")
    return camera_info(stamp_ns, frame_id, *size, str(message["distortion_model"]), *matrices)


_JSON: Final[dict[str, Callable[[bytes], Message]]] = {
    "PointCloud": _json_cloud,
    "CompressedImage": _json_compressed,
    "CompressedVideo": _json_video,
    "RawImage": _json_raw,
    "CameraCalibration": _json_calibration,
}
