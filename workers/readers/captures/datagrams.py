"""UDP datagrams out of captured frames: VLAN tags, other link layers, fragments."""

from __future__ import annotations

import struct
from collections import OrderedDict
from ipaddress import ip_address
from typing import Final

_ETHERNET: Final = 1
# link type: (where the EtherType stands, where the network layer begins)
_LINKS: Final = {_ETHERNET: (12, 14), 113: (14, 16), 276: (0, 20)}
_RAW_LINKS: Final = frozenset({12, 14, 101, 228, 229})
_LOOPBACK_LINKS: Final = frozenset({0, 108})
KNOWN_LINKS: Final = frozenset(_LINKS) | _RAW_LINKS | _LOOPBACK_LINKS
_TAGS: Final = frozenset({0x8100, 0x88A8, 0x9100})
_UDP: Final = 17
_WAITING: Final = 64
_LONGEST: Final = 65_535

# (address of the sender, its port, port of the receiver, payload); the address as the 4 or 16 bytes of IP
Datagram = tuple[bytes, int, int, bytes]


def endpoint(sender: bytes, port: int) -> str:
    """A sender and the port it sends to, as people write them."""
    address = ip_address(sender)
    return f"{address}:{port}" if address.version == 4 else f"[{address}]:{port}"


# What nearly every frame of a sensor is: Ethernet, IPv4 without options, in one piece.
_PLAIN: Final = struct.Struct(">3sxH2xHxB2x4s4xHHH")
_PLAIN_KIND: Final = b"\x08\x00\x45"


class Datagrams:
    """Takes captured frames and gives the UDP datagrams in them; puts fragments together.

    Attributes:
        fragments: pieces that never found the rest.
    """

    def __init__(self) -> None:
        self._waiting: OrderedDict[bytes, dict[int, bytes]] = OrderedDict()
        self.fragments = 0

    def take(self, link: int, frame: bytes) -> Datagram | None:
        """The datagram that this frame holds or completes."""
        if link == _ETHERNET and len(frame) >= 42:
            kind, total, piece, protocol, sender, source, port, length = _PLAIN.unpack_from(frame, 12)
            plain = kind == _PLAIN_KIND and protocol == _UDP and not piece & 0x3FFF
            if plain and 8 < length == total - 20 and len(frame) >= 14 + total:
                return sender, source, port, frame[42 : 14 + total]
        offset = _network(link, frame)
        if offset is None or len(frame) < offset + 28:
            return None
        version = frame[offset] >> 4
        if version == 4:
            return self._ipv4(frame, offset)
        if version == 6 and frame[offset + 6] == _UDP and len(frame) >= offset + 48:
            return _udp(frame[offset + 8 : offset + 24], frame[offset + 40 :])
        return None

    def _ipv4(self, frame: bytes, offset: int) -> Datagram | None:
        if frame[offset + 9] != _UDP:
            return None
        start = offset + 4 * (frame[offset] & 15)
        stop = offset + int.from_bytes(frame[offset + 2 : offset + 4], "big")
        sender = frame[offset + 12 : offset + 16]
        piece = int.from_bytes(frame[offset + 6 : offset + 8], "big") & 0x3FFF
        if stop <= start:  # a card that segments by itself leaves the length at 0
            stop = len(frame)
        if not piece:
            return _udp(sender, frame[start:stop])
        key = frame[offset + 4 : offset + 6] + frame[offset + 12 : offset + 20]
        whole = self._join(key, piece, frame[start:stop])
        return None if whole is None else _udp(sender, whole)

    def _join(self, key: bytes, piece: int, data: bytes) -> bytes | None:
        """Keep a fragment until its datagram is whole; ``piece`` is IP's more-fragments bit and offset / 8."""
        pieces = self._waiting.setdefault(key, {})
        pieces[piece] = data
        whole = bytearray()
        for flags in sorted(pieces, key=lambda p: p & 0x1FFF):
            if (flags & 0x1FFF) * 8 != len(whole) or len(whole) > _LONGEST:
                break
            whole += pieces[flags]
            if not flags & 0x2000:
                del self._waiting[key]
                return bytes(whole)
        if len(self._waiting) > _WAITING:
            self.fragments += len(self._waiting.popitem(last=False)[1])
        return None


def _network(link: int, frame: bytes) -> int | None:
    """Return where the IP header begins; None if there is none."""
    if link in _RAW_LINKS:
        return 0
    if link in _LOOPBACK_LINKS:
        return 4
    if link not in _LINKS:
        return None
    at, offset = _LINKS[link]
    kind = int.from_bytes(frame[at : at + 2], "big")
    for _ in range(3):
        if kind not in _TAGS:
            break
        kind = int.from_bytes(frame[offset + 2 : offset + 4], "big")
        offset += 4
    return offset if kind in (0x0800, 0x86DD) else None


def _udp(sender: bytes, segment: bytes) -> Datagram | None:
    if len(segment) < 8:
        return None
    length = int.from_bytes(segment[4:6], "big")
    payload = segment[8:length] if length > 8 else segment[8:]
    return sender, int.from_bytes(segment[0:2], "big"), int.from_bytes(segment[2:4], "big"), payload
