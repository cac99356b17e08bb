"""Foxglove's messages that are written, as the descriptors that MCAP files carry for protobuf.

Names, numbers and types of the fields are those of docs.foxglove.dev, "Message schemas". The numbers below are those
of google/protobuf/descriptor.proto.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from workers.readers.viewing.protobuf_writing import block, integer, text

ENCODING: Final = "protobuf"
_TIME: Final = ".google.protobuf.Timestamp"
_DOUBLE, _INT64, _INT32, _FIXED32, _STRING, _MESSAGE, _BYTES, _ENUM = 1, 3, 5, 7, 9, 11, 12, 14
_ONE, _MANY = 1, 3  # labels: optional, repeated
_NUMERIC: Final = ".foxglove.PackedElementField.NumericType"
_NUMERIC_TYPES: Final = ("UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64")


class _Field(NamedTuple):
    """``type_name`` is that of a message or an enumeration."""

    name: str
    number: int
    type: int
    type_name: str = ""
    label: int = _ONE


def _listed(names: str, type: int, first: int = 1) -> list[_Field]:
    return [_Field(name, number, type) for number, name in enumerate(names.split(), start=first)]


_MESSAGES: Final[Mapping[str, Sequence[_Field]]] = {
    "Vector3": _listed("x y z", _DOUBLE),
    "Quaternion": _listed("x y z w", _DOUBLE),
    "Pose": [
        _Field("position", 1, _MESSAGE, ".foxglove.Vector3"),
        _Field("orientation", 2, _MESSAGE, ".foxglove.Quaternion"),
    ],
    "PackedElementField": [
        _Field("name", 1, _STRING),
        _Field("offset", 2, _FIXED32),
        _Field("type", 3, _ENUM, _NUMERIC),
    ],
    "PointCloud": [
        _Field("timestamp", 1, _MESSAGE, _TIME),
        _Field("frame_id", 2, _STRING),
        _Field("pose", 3, _MESSAGE, ".foxglove.Pose"),
        _Field("point_stride", 4, _FIXED32),
        _Field("fields", 5, _MESSAGE, ".foxglove.PackedElementField", _MANY),
        _Field("data", 6, _BYTES),
    ],
    "CompressedImage": [
        _Field("timestamp", 1, _MESSAGE, _TIME),
        _Field("data", 2, _BYTES),
        _Field("format", 3, _STRING),
        _Field("frame_id", 4, _STRING),
    ],
    "CameraCalibration": [
        _Field("timestamp", 1, _MESSAGE, _TIME),
        *_listed("width height", _FIXED32, 2),
        _Field("distortion_model", 4, _STRING),
        *(one._replace(label=_MANY) for one in _listed("D K R P", _DOUBLE, 5)),
        _Field("frame_id", 9, _STRING),
    ],
    "FrameTransform": [
        _Field("timestamp", 1, _MESSAGE, _TIME),
        *_listed("parent_frame_id child_frame_id", _STRING, 2),
        _Field("translation", 4, _MESSAGE, ".foxglove.Vector3"),
        _Field("rotation", 5, _MESSAGE, ".foxglove.Quaternion"),
    ],
    "FrameTransforms": [_Field("transforms", 1, _MESSAGE, ".foxglove.FrameTransform", _MANY)],
}


def descriptor_set() -> bytes:
    """A serialized FileDescriptorSet: the messages above, and the time that they hold."""
    time = _message("Timestamp", [_Field("seconds", 1, _INT64), _Field("nanos", 2, _INT32)])
    numeric = text(1, "NumericType") + b"".join(
        block(2, text(1, name) + integer(2, number)) for number, name in enumerate(_NUMERIC_TYPES)
    )
    messages = [
        _message(name, fields) + (block(4, numeric) if name == "PackedElementField" else b"")
        for name, fields in _MESSAGES.items()
    ]
    time_file = "google/protobuf/timestamp.proto"
    return block(1, _file(time_file, "google.protobuf", [], [time])) + block(
        1, _file("foxglove.proto", "foxglove", [time_file], messages)
    )


def _file(name: str, package: str, needed: Sequence[str], messages: Sequence[bytes]) -> bytes:
    parts = [text(1, name), text(2, package), *(text(3, one) for one in needed)]
    return b"".join([*parts, *(block(4, one) for one in messages), text(12, "proto3")])


def _message(name: str, fields: Sequence[_Field]) -> bytes:
    return text(1, name) + b"".join(block(2, _field(one)) for one in fields)


def _field(field: _Field) -> bytes:
    numbers = integer(3, field.number) + integer(4, field.label) + integer(5, field.type)
    return text(1, field.name) + numbers + (text(6, field.type_name) if field.type_name else b"")
