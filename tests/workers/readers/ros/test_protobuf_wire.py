import struct

import pytest

from workers.readers.ros.protobuf_wire import WireError, doubles, fields_of, last, number, text


def test_every_wire_type():
    raw = (
        b"\x08\x96\x01"  # field 1, varint 150, the example of the documentation
        + b"\x12\x07testing"  # field 2, text
        + b"\x1d"
        + struct.pack("<I", 7)  # field 3, fixed32
        + b"\x21"
        + struct.pack("<d", 2.5)  # field 4, fixed64
        + b"\x2a\x10"
        + struct.pack("<2d", 1.5, -3.0)  # field 5, packed doubles
    )
    fields = fields_of(raw)
    assert (number(fields, 1), text(fields, 2), number(fields, 3)) == (150, "testing", 7)
    assert list(doubles(fields, 4)) == [2.5] and list(doubles(fields, 5)) == [1.5, -3.0]
    assert (number(fields, 9), text(fields, 9), last(fields, 9), list(doubles(fields, 9))) == (0, "", None, [])


def test_the_last_of_several_counts():
    assert number(fields_of(b"\x08\x01\x08\x02"), 1) == 2


@pytest.mark.parametrize(
    "raw",
    [
        b"\x08",  # no value
        b"\x08" + b"\xff" * 11,  # a number without end
        b"\x12\x7fshort",  # longer than what is there
        b"\x12\xff\xff\xff\xff\xff\xff\xff\xff\x7f",
        b"\x1d\x00",  # half a fixed32
        b"\x0b\x0c",  # a group
        b"\x08\x00" * 100_001,
    ],
)
def test_what_is_no_message(raw):
    with pytest.raises(WireError):
        fields_of(raw)


def test_fields_of_another_kind():
    fields = fields_of(b"\x08\x01\x12\x03abc")
    for read, key in ((text, 1), (number, 2), (doubles, 2)):
        with pytest.raises(WireError):
            read(fields, key)
