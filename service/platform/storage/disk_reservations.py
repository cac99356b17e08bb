"""Reservations of free disk space, so that uploads under way never fill the disk together."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, AsyncIterator
from contextlib import asynccontextmanager
from time import monotonic

from service.platform.settings import MIB
from service.platform.storage.errors import StoreFullError
from service.platform.storage.store import Store

# The disk is checked again after this many bytes of a part, because others write to it, too.
_LOOK_EVERY = 8 * MIB
# A part that comes more slowly than this after its first seconds trickles: 64 MiB would take eleven minutes. It
# reserves only what came, buffers included, and the next step.
_TRICKLE_BYTES_PER_S = 100_000
_FIRST_S = 2.0
_STEP = 4 * MIB


class DiskReservations:
    """The reservations of an application, used from its event loop alone; ``reserve`` bytes always stay free."""

    def __init__(self, store: Store, reserve: int) -> None:
        self._store = store
        self._reserve = reserve
        self._parts: set[Reservation] = set()

    @asynccontextmanager
    async def reserve(self, size: int) -> AsyncIterator[Reservation]:
        """Reserve ``size`` bytes until the block ends. Raises :class:`StoreFullError`.

        A part counts whole until it has arrived, unless it trickles: its bytes may still lie in buffers.
        """
        part = Reservation(self, size)
        self._parts.add(part)
        try:
            free = await self.shortage()
            if free is not None:
                raise StoreFullError(free)
            yield part
        finally:
            self._parts.discard(part)

    async def shortage(self, size: int | None = None) -> int | None:
        """Return the free bytes if they do not suffice for ``size`` bytes, by default all parts; else None."""
        # A disk that hangs must not hang the event loop.
        free = await asyncio.to_thread(self._store.free_bytes)
        if size is None:
            size = sum(part.reserved() for part in self._parts)
        return free if free is not None and free - size < self._reserve else None


class Reservation:
    """The reservation of one part. ``lost``: free bytes of the disk when it became too full during the upload."""

    def __init__(self, reservations: DiskReservations, size: int) -> None:
        self.lost: int | None = None
        self._reservations = reservations
        self._size = self._reserved = size
        self._came = 0
        self._began = monotonic()

    def reserved(self) -> int:
        """Return the bytes reserved for it now."""
        if self._came < _TRICKLE_BYTES_PER_S * (monotonic() - self._began - _FIRST_S):
            self._reserved = min(self._reserved, self._came + _STEP)
        return self._reserved

    async def watch(self, chunks: AsyncIterable[bytes]) -> AsyncIterator[bytes]:
        """Pass the part's bytes on; end when the disk is too full for them or for the rest."""
        looked_at = 0
        async for chunk in chunks:
            self._came += len(chunk)
            if self._came > self._reserved:
                self._reserved = min(max(self._size, self._came), self._came + _STEP)
                self.lost = await self._reservations.shortage()
            elif self._came - looked_at >= _LOOK_EVERY:
                looked_at = self._came
                self.lost = await self._reservations.shortage(self._reserved - self._came)
            if self.lost is not None:
                return
            yield chunk
