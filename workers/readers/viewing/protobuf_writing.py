"""The fields of a protobuf message as they stand on the wire (protobuf.dev, "Encoding")."""

from __future__ import annotations

import struct
from collections.abc import Iterable

_VARINT, _LENGTH, _FIXED32, _DOUBLE = 0, 2, 5, 1


def integer(key: int, value: int) -> bytes:
    """A field of a whole number of any type but the fixed ones; not negative."""
    return _key(key, _VARINT) + _varint(value)


def fixed32(key: int, value: int) -> bytes:
    """A field of the type fixed32."""
    return _key(key, _FIXED32) + struct.pack("<I", value)


def named_doubles(values: Iterable[float]) -> bytes:
    """A message whose fields 1, 2, ... are doubles: x, y, z of a vector."""
    return b"".join(_key(key, _DOUBLE) + struct.pack("<d", value) for key, value in enumerate(values, start=1))


def doubles(key: int, values: Iterable[float]) -> bytes:
    """A repeated field of doubles, packed."""
    listed = list(values)
    return block(key, struct.pack(f"<{len(listed)}d", *listed))


def text(key: int, value: str) -> bytes:
    """A field of the type string."""
    return block(key, value.encode())


def block(key: int, data: bytes) -> bytes:
    """A field of bytes, or of a message."""
    return block_head(key, len(data)) + data


def block_head(key: int, size: int) -> bytes:
    """What stands before the ``size`` bytes of such a field."""
    return _key(key, _LENGTH) + _varint(size)


def _key(key: int, kind: int) -> bytes:
    return _varint(key << 3 | kind)


def _varint(value: int) -> bytes:
    made = bytearray()
    while value > 0x7F:
        made.append(value & 0x7F | 0x80)
        value >>= 7
    made.append(value)
    return bytes(made)
