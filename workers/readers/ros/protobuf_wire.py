"""The wire format of protobuf, as far as a message is a list of numbered fields (protobuf.dev, "Encoding")."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

Value = int | memoryview
Fields = dict[int, list[Value]]

_MAX_FIELDS: Final = 100_000


class WireError(Exception):
    """Bytes that are no protobuf message."""


def fields_of(raw: bytes | memoryview) -> Fields:
    """The fields of a message by number: varints and fixed ones as int, the rest as views of their bytes.

    Raises:
        WireError: a field that goes past the end, a group, or a number that is too long.
    """
    view = memoryview(raw)
    fields: Fields = {}
    place = count = 0
    while place < len(view):
        key, place = _varint(view, place)
        count += 1
        if count > _MAX_FIELDS:
            raise WireError(f"more than {_MAX_FIELDS} fields")
        kind = key & 7
        if kind == 0:
            value, place = _varint(view, place)
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
            value = int.from_bytes(_take(view, place, size), "little")
            place += size
        elif kind == 2:
            size, place = _varint(view, place)
            value = _take(view, place, size)
            place += size
        else:
            raise WireError(f"a field of wire type {kind} at byte {place}")
        fields.setdefault(key >> 3, []).append(value)
    return fields


def _varint(view: memoryview, place: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        if place >= len(view) or shift > 63:
            raise WireError(f"a number at byte {place} does not end")
        byte = view[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value & 0xFFFF_FFFF_FFFF_FFFF, place
        shift += 7


def _take(view: memoryview, place: int, size: int) -> memoryview:
    if size > len(view) - place:
        raise WireError(f"a field of {size} bytes at byte {place} goes past the end")
    return view[place : place + size]


def last(fields: Fields, key: int) -> Value | None:
    """The value that counts where a field comes several times."""
    return fields[key][-1] if key in fields else None


def number(fields: Fields, key: int) -> int:
    """An integer field; 0 where it is absent, as proto3 says."""
    value = last(fields, key)
    if isinstance(value, memoryview):
        raise WireError(f"field {key} is no number")
    return value or 0


def text(fields: Fields, key: int) -> str:
    """A string field; empty where it is absent."""
    value = last(fields, key)
    if isinstance(value, int):
        raise WireError(f"field {key} is no text")
    return bytes(value or b"").decode(errors="replace")


def doubles(fields: Fields, key: int) -> Sequence[float]:
    """A repeated double, packed or not."""
    found: list[float] = []
    for value in fields.get(key, ()):
        raw = value.to_bytes(8, "little") if isinstance(value, int) else bytes(value)
        if len(raw) % 8:
            raise WireError(f"field {key} holds no doubles")
        found.extend(struct.unpack(f"<{len(raw) // 8}d", raw))
    return found
