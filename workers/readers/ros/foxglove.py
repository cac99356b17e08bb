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

from workers.readers.mcap_io.records import RecordError
from workers.readers.ros.foxglove_messages import FOXGLOVE_MESSAGES
from workers.readers.ros.topic_messages import BagTopic, Decoder

# All of a message but its `data`: a cloud of 30 fields takes less than 1 kB. An empty field of two bytes becomes an
# object of 200.
_MAX_BESIDE_DATA: Final = 256 * 1024
_CLASSES: Final[dict[str, Any]] = {
    kind.DESCRIPTOR.name: kind for kind in (PointCloud, CompressedImage, CompressedVideo, RawImage, CameraCalibration)
}


def foxglove_decoder(topic: BagTopic) -> Decoder | None:
    """How messages of this topic are read, None where they are none of these types, or in another encoding."""
    package, _, name = topic.type.rpartition(".")
    parse = {"protobuf": _from_protobuf, "json": _from_json}.get(topic.encoding)
    if package != "foxglove" or name not in _CLASSES or parse is None:
        return None
    kind, read = _CLASSES[name], FOXGLOVE_MESSAGES[name]
    return lambda raw: read(_guarded(parse, kind, raw))


def _guarded(parse: Callable[[Any, bytes], Any], kind: Any, raw: bytes) -> Any:
    try:
        message = parse(kind, raw)
    except (DecodeError, ParseError) as error:
        raise RecordError(f"a message is no {kind.DESCRIPTOR.full_name} ({error})") from error
    for part in (message, message.timestamp, *getattr(message, "fields", ())):
        # New fields of a schema come with new numbers; a number of ours with another type is damage.
        if any(field.field_number in part.DESCRIPTOR.fields_by_number for field in UnknownFieldSet(part)):
            raise RecordError(f"a field of a {part.DESCRIPTOR.full_name} has another type")
    return message


def _from_protobuf(kind: Any, raw: bytes) -> Any:
    data = kind.DESCRIPTOR.fields_by_name.get("data")
    if _beside(memoryview(raw), 0 if data is None else data.number) > _MAX_BESIDE_DATA:
        raise RecordError(f"a message holds more than {_MAX_BESIDE_DATA} bytes beside its data")
    return kind.FromString(raw)


def _beside(view: memoryview, payload: int) -> int:
    """Bytes of a message beside the field with the number ``payload``, or a number beyond the bound.

    The wire format is that of protobuf.dev, "Encoding".

    Raises:
        RecordError: a group, or a number that does not end.
    """
    offset = beside = 0
    while offset < len(view) and beside <= _MAX_BESIDE_DATA:
        start = offset
        key, offset = _varint(view, offset)
        wire = key & 7
        if wire == 2:
            size, offset = _varint(view, offset)
            if key >> 3 == payload:
                beside -= size
            offset += size
        elif wire == 0:
            _, offset = _varint(view, offset)
        elif wire in (1, 5):
            offset += 8 if wire == 1 else 4
        else:
            raise RecordError(f"a field of wire type {wire} at byte {start}")
        beside += offset - start
    return beside


def _varint(view: memoryview, offset: int) -> tuple[int, int]:
    value = 0
    for shift, byte in enumerate(view[offset : offset + 10]):
        value |= (byte & 0x7F) << 7 * shift
        if byte < 0x80:
            return value, offset + shift + 1
    raise RecordError(f"a number at byte {offset} does not end")


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
