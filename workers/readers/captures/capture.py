"""Packets of network captures: pcap and pcapng, read in a stream."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

from workers.readers.recording import ReadError

# First four bytes: byte order and nanoseconds in one unit of the stamps' fraction.
_PCAP: Final = {
    b"\xd4\xc3\xb2\xa1": ("<", 1000),
    b"\xa1\xb2\xc3\xd4": (">", 1000),
    b"\x4d\x3c\xb2\xa1": ("<", 1),
    b"\xa1\xb2\x3c\x4d": (">", 1),
}
_PCAPNG: Final = b"\x0a\x0d\x0d\x0a"
_BUFFER: Final = 1 << 20
_LARGEST: Final = 1 << 18  # no network has longer frames; tcpdump's own limit
_LARGEST_BLOCK: Final = 1 << 24
_LAST_NS: Final = 2**32 * 1_000_000_000  # as far as a pcap's stamps reach

# (host's stamp in nanoseconds since 1970, link type, frame)
CapturedFrame = tuple[int, int, bytes]


class CaptureFile:
    """A capture file, read from its beginning.

    Attributes:
        path: the file.
        size: bytes.
        position: bytes read so far.
        cut_short: a sentence where the file ends inside a packet, else empty.
        untimed: packets without a stamp, or one beyond 2106, which were left out.
        snapped, snap_bytes: packets of which only a part was captured, and the longest of these parts.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.size = path.stat().st_size
        self.position = 0
        self.cut_short = ""
        self.untimed = 0
        self.snapped = self.snap_bytes = 0

    def frames(self) -> Iterator[CapturedFrame]:
        """Every frame in recorded order, from the beginning.

        Raises:
            ReadError: ``capture_damaged``.
        """
        self.position, self.cut_short, self.untimed = 0, "", 0
        self.snapped = self.snap_bytes = 0
        with self.path.open("rb") as file:
            head = file.read(4)
            file.seek(0)
            yield from self._pcapng(file) if head == _PCAPNG else self._pcap(file)

    def _pcap(self, file: BinaryIO) -> Iterator[CapturedFrame]:
        head = file.read(24)
        if head[:4] not in _PCAP or len(head) < 24:
            raise self._damaged("its header is not whole")
        order, unit_ns = _PCAP[head[:4]]
        link = struct.unpack_from(order + "I", head, 20)[0] & 0x0FFFFFFF
        record = struct.Struct(order + "IIII")
        self.position = 24
        buffer, offset = b"", 0
        while True:
            if len(buffer) - offset < 16:
                buffer, offset = buffer[offset:] + file.read(_BUFFER), 0
                if len(buffer) < 16:
                    self._note_rest(len(buffer))
                    return
            sec, fraction, length, whole = record.unpack_from(buffer, offset)
            if length > _LARGEST or fraction * unit_ns >= 2_000_000_000:
                raise self._damaged(f"the packet at byte {self.position} claims {length} bytes")
            end = offset + 16 + length
            if end > len(buffer):
                buffer, offset = buffer[offset:] + file.read(_BUFFER), 0
                end = 16 + length
                if end > len(buffer):
                    self._note_rest(len(buffer))
                    return
            self.position += 16 + length
            if length < whole:
                self._note_snapped(length)
            yield sec * 1_000_000_000 + fraction * unit_ns, link, buffer[offset + 16 : end]
            offset = end

    def _pcapng(self, file: BinaryIO) -> Iterator[CapturedFrame]:
        order = "<"
        interfaces: list[_Interface] = []
        for kind, body, order in self._blocks(file):
            try:
                if kind == 0x0A0D0D0A:
                    interfaces.clear()
                elif kind == 1:
                    interfaces.append(_Interface.read(body, order))
                elif kind in (6, 2):  # enhanced packet, and the older form with a count of drops
                    index, high, low, length = struct.unpack_from(order + ("IIII" if kind == 6 else "H2xIII"), body)
                    frame = self._timed(interfaces[int(index)], high << 32 | low, body, length, order)
                    if 0 <= frame[0] < _LAST_NS:
                        yield frame
                    else:
                        self.untimed += 1
                elif kind == 3:
                    self.untimed += 1
            except (struct.error, IndexError) as error:
                raise self._damaged(f"the block before byte {self.position} contradicts itself") from error

    def _timed(self, interface: _Interface, ticks: int, body: bytes, length: int, order: str) -> CapturedFrame:
        if length > len(body) - 20:
            raise self._damaged(f"the packet before byte {self.position} claims {length} bytes")
        if length < struct.unpack_from(order + "I", body, 16)[0]:
            self._note_snapped(length)
        return interface.to_ns(ticks), interface.link, body[20 : 20 + length]

    def _blocks(self, file: BinaryIO) -> Iterator[tuple[int, bytes, str]]:
        """(type, body, byte order) of every block."""
        order = "<"
        while head := file.read(12):
            if len(head) < 12:
                self._note_rest(len(head))
                return
            if head[:4] == _PCAPNG:
                order = "<" if head[8:12] == b"\x4d\x3c\x2b\x1a" else ">"
                if order == ">" and head[8:12] != b"\x1a\x2b\x3c\x4d":
                    raise self._damaged(f"the section at byte {self.position} has no byte order")
            kind, length = struct.unpack_from(order + "II", head)
            if length < 12 or length % 4 or length > _LARGEST_BLOCK:
                raise self._damaged(f"the block at byte {self.position} claims {length} bytes")
            rest = file.read(length - 12)
            if len(rest) < length - 12:
                self._note_rest(12 + len(rest))
                return
            body = head[8:] + rest
            if struct.unpack_from(order + "I", body, len(body) - 4)[0] != length:
                raise self._damaged(f"the block at byte {self.position} does not end as it began")
            self.position += length
            yield kind, body[:-4], order

    def _note_snapped(self, length: int) -> None:
        self.snapped += 1
        self.snap_bytes = max(self.snap_bytes, length)

    @property
    def snap_sentence(self) -> str:
        """Say how much the capture's snap length cut off; empty if packets are whole."""
        if not self.snapped:
            return ""
        return (
            f"{self.snapped} packets were captured in part only, at most {self.snap_bytes} bytes of each: the "
            "capture's snap length cut them off. Capture again with `tcpdump -s 0`."
        )

    def _note_rest(self, rest: int) -> None:
        if rest:
            self.cut_short = (
                f"{self.path.name} ends inside a packet ({rest} bytes of it, at byte {self.position}); what came "
                "before was read."
            )

    def _damaged(self, why: str) -> ReadError:
        return ReadError(
            "capture_damaged",
            f"{self.path.name} is a packet capture but cannot be read: {why}.",
            "Copy or upload the file again; if it stays so, `editcap` or Wireshark may save what is left.",
        )


class _Interface:
    """A pcapng interface: its link type and the unit of its stamps."""

    def __init__(self, link: int, per_second: int, offset_s: int) -> None:
        self.link = link
        self._per_second = per_second
        self._offset_ns = offset_s * 1_000_000_000

    @classmethod
    def read(cls, body: bytes, order: str) -> _Interface:
        """Read an interface description block; options 9 and 14 are if_tsresol and if_tsoffset."""
        (link,) = struct.unpack_from(order + "H", body)
        per_second, offset_s, offset = 1_000_000, 0, 8
        while offset + 4 <= len(body):
            code, length = struct.unpack_from(order + "HH", body, offset)
            if code == 0:
                break
            if code == 9 and length == 1:
                exponent = body[offset + 4]
                per_second = 2 ** (exponent & 0x7F) if exponent & 0x80 else 10 ** min(exponent, 18)
            elif code == 14 and length == 8:
                (offset_s,) = struct.unpack_from(order + "q", body, offset + 4)
            offset += 4 + length + -length % 4
        return cls(link, per_second, offset_s)

    def to_ns(self, ticks: int) -> int:
        """Nanoseconds since 1970."""
        return ticks * 1_000_000_000 // self._per_second + self._offset_ns
