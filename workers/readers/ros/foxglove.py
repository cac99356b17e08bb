"""Foxglove's own messages in protobuf or JSON, parsed by the classes of foxglove-schemas-protobuf."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from typing import Any, Final

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.json_format import ParseDict, ParseError
from google.protobuf.message import DecodeError
from google.protobuf.unknown_fields import UnknownFieldSet

from workers.readers.ros.foxglove_messages import FOXGLOVE_MESSAGES
from workers.readers.ros.mcap_records import RecordError
from workers.readers.ros.topic_messages import BagTopic, Decoder

_MOST_FIELDS: Final = 256  # of a point: each becomes an object of Python
_CLASSES: Final[dict[str, Any]] = {
    kind.DESCRIPTOR.name: kind for kind in (PointCloud, CompressedImage, CompressedVideo, RawImage, CameraCalibration)
}


def foxglove_decoder(topic: BagTopic) -> Decoder | None:
    """Return the decoder of this topic's messages; None for other types or another encoding."""
    package, _, name = topic.type.rpartition(".")
    parse = _PARSERS.get(topic.encoding)
    if package != "foxglove" or name not in _CLASSES or parse is None:
        return None
    kind, read = _CLASSES[name], FOXGLOVE_MESSAGES[name]
    return lambda raw: read(_guarded(parse, kind, raw))


def _guarded(parse: Callable[[Any, bytes], Any], kind: Any, raw: bytes) -> Any:
    try:
        message = parse(kind, raw)
    except (DecodeError, ParseError) as error:
        raise RecordError(f"a message is no {kind.DESCRIPTOR.full_name} ({error})") from error
    fields: Any = getattr(message, "fields", ())
    if len(fields) > _MOST_FIELDS:
        raise RecordError(f"a {kind.DESCRIPTOR.full_name} has {len(fields)} fields a point")
    for part in (message, message.timestamp, *fields):
        # New fields of a schema come with new numbers; a number of ours with another type is damage.
        if any(field.field_number in part.DESCRIPTOR.fields_by_number for field in UnknownFieldSet(part)):
            raise RecordError(f"a field of a {part.DESCRIPTOR.full_name} has another type")
    return message


def _from_json(kind: Any, raw: bytes) -> Any:
    """Its time is an object of ``sec`` and ``nsec``, unlike protobuf's own JSON; its data must be whole base64."""
    document: dict[str, Any] = json.loads(raw)
    time: dict[str, Any] = document.pop("timestamp", None) or {}
    data = base64.b64decode(document.pop("data", ""), validate=True)
    message = ParseDict(document, kind(), ignore_unknown_fields=True)
    message.timestamp.seconds, message.timestamp.nanos = int(time.get("sec", 0)), int(time.get("nsec", 0))
    if data:
        message.data = data
    return message


_PARSERS: Final[dict[str, Callable[[Any, bytes], Any]]] = {
    "protobuf": lambda kind, raw: kind.FromString(raw),
    "json": _from_json,
}
