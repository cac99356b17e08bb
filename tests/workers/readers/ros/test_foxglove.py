import json
import struct

import pytest
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.internal.encoder import _VarintBytes

from workers.readers.ros.foxglove import foxglove_decoder
from workers.readers.ros.mcap_records import RecordError
from workers.readers.ros.topic_messages import BagTopic


def field(number, value):
    """A field on the wire: bytes or text, or a (kind, int) pair: ``v`` varint, ``f`` fixed32; all numbers small."""
    if isinstance(value, tuple):
        kind, integer = value
        return bytes([number << 3, integer]) if kind == "v" else struct.pack("<BI", number << 3 | 5, integer)
    data = value.encode() if isinstance(value, str) else value
    return _VarintBytes(number << 3 | 2) + _VarintBytes(len(data)) + data


def decode(name, raw, encoding="protobuf"):
    return foxglove_decoder(BagTopic("/a", f"foxglove.{name}", encoding, "", "", None))(raw)


def cloud(**more):
    fields = [PackedElementField(name=name, offset=4 * i, type=7) for i, name in enumerate("xyz")]
    message = PointCloud(frame_id="lidar", point_stride=12, fields=fields, data=bytes(24), **more)
    message.timestamp.FromNanoseconds(1_600_000_000_000_000_005)
    return message.SerializeToString()


def test_a_cloud_of_the_schemas_own_writer():
    message = decode("PointCloud", cloud())
    assert (message.stamp_ns, message.frame_id) == (1_600_000_000_000_000_005, "lidar")
    assert [(f.name, f.offset, f.datatype) for f in message.cloud.fields] == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    assert (message.cloud.width, message.cloud.point_step, len(message.cloud.data)) == (2, 12, 24)


def test_the_last_of_several_counts():
    assert decode("CompressedImage", field(2, b"one") + field(2, b"two")).data == b"two"


@pytest.mark.parametrize(("name", "form"), [("UINT8", 2), ("INT8", 1), ("UINT16", 4), ("INT16", 3), ("UINT32", 6)])
def test_types_with_and_without_a_sign_are_those_of_ros(name, form):
    column = PackedElementField(name="ring", type=PackedElementField.NumericType.Value(name))
    message = decode("PointCloud", PointCloud(point_stride=4, fields=[column]).SerializeToString())
    assert message.cloud.fields[0].datatype == form


NO_MESSAGES = [
    # What is no message.
    (b"\x08", None),  # no value
    (b"\x08" + b"\xff" * 11, None),  # a number without end
    (b"\x12\x7fshort", None),  # longer than what is there
    (b"\x12\xff\xff\xff\xff\xff\xff\xff\xff\x7f", None),
    (b"\x1d\x00", None),  # half a fixed32
    (b"\x0b\x0c", None),  # a group
    (b"\x12\x02\xff\xff", None),  # no UTF-8
    # A field of another type is no default.
    (cloud() + field(4, ("v", 12)), None),  # the stride as a varint
    (cloud() + field(2, ("f", 12)), None),  # the frame's name as a number
    (cloud() + field(6, ("v", 1)), None),  # the points as a number
    (cloud() + field(5, field(2, ("v", 4))), None),  # a column's offset as a varint
    (cloud() + field(1, field(1, b"1")), None),  # a time's seconds as text
    (b"\x2a\x00" * 257, "257 fields a point"),
]


@pytest.mark.parametrize(("raw", "words"), NO_MESSAGES, ids=range(len(NO_MESSAGES)))
def test_what_is_no_message_is_refused(raw, words):
    with pytest.raises(RecordError, match=words):
        decode("PointCloud", raw)


def test_points_without_a_stride_are_no_empty_cloud():
    assert decode("PointCloud", b"").cloud.width == 0
    with pytest.raises(ValueError, match="no stride"):
        decode("PointCloud", field(6, bytes(24)))


@pytest.mark.parametrize(
    ("name", "document"),
    [
        *(
            ("CompressedImage", {"timestamp": {"sec": 1, "nsec": 2}, "data": data})
            for data in ("!!!!", "YQ", 1, None)
        ),
        *(("CameraCalibration", one) for one in ([], {"width": "wide"}, {"width": -1}, {"K": [[1.0]]})),
    ],
)
def test_json_of_another_shape_or_without_base64(name, document):
    with pytest.raises((RecordError, ValueError, TypeError)):
        decode(name, json.dumps(document).encode(), "json")
