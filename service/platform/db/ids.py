"""Identifiers of rows that the outside sees: random, and sorted by the time they were made (RFC 9562, version 7)."""

from __future__ import annotations

import os
import time
from uuid import UUID


def new_id() -> UUID:
    """A UUID version 7: 48 bits of Unix milliseconds, 12 of their fraction, then 62 random bits.

    With the fraction (RFC 9562, section 6.2, method 3) rows that one process makes one after the other sort so.
    """
    stamp, within = divmod(time.time_ns(), 1_000_000)
    head = (stamp & (1 << 48) - 1) << 80 | 0x7 << 76 | (within << 12) // 1_000_000 << 64
    return UUID(int=head | 0x2 << 62 | int.from_bytes(os.urandom(8), "big") >> 2)
