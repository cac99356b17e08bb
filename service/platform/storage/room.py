"""Free disk space for uploads, less what is being uploaded now."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, AsyncIterator
from contextlib import asynccontextmanager
from time import monotonic

from service.platform.settings import MIB
from service.platform.storage.errors import StoreFullError
from service.platform.storage.store import Store

# The disk is looked at again after so many bytes of a part, because others write to it too.
_LOOK_EVERY = 8 * MIB
# A part that has come more slowly than this since its first seconds trickles: 64 MiB would take eleven minutes. Its
# room is what came, buffers included, and the next step.
_TRICKLE_BYTES_PER_S = 100_000
_FIRST_S = 2.0
_STEP = 4 * MIB


class Room:
    """One object for an application, used from its event loop alone. ``reserve`` bytes of the disk stay free."""

    def __init__(self, store: Store, reserve: int) -> None:
        self._store = store
        self._reserve = reserve
        self._parts: set[Kept] = set()

    @asynccontextmanager
    async def kept_for(self, size: int) -> AsyncIterator[Kept]:
        """Room for ``size`` bytes until the block ends. Raises :class:`StoreFullError`.

        A part counts whole until it has arrived, unless it trickles: nobody knows how much of it lies in buffers.
        """
        part = Kept(self, size)
        self._parts.add(part)
        try:
            free = await self.lacks()
            if free is not None:
                raise StoreFullError(free)
            yield part
        finally:
            self._parts.discard(part)

    async def lacks(self, size: int | None = None) -> int | None:
        """What is free, where that is too little for ``size`` bytes, by default all parts; else None."""
        # A disk that hangs must not hang the event loop.
        free = await asyncio.to_thread(self._store.free_bytes)
        if size is None:
            size = sum(part.promised() for part in self._parts)
        return free if free is not None and free - size < self._reserve else None


class Kept:
    """The room of one part. ``lost`` is what the disk had free when it got too full while the bytes came."""

    def __init__(self, room: Room, size: int) -> None:
        self.lost: int | None = None
        self._room = room
        self._size = self._promised = size
        self._came = 0
        self._began = monotonic()

    def promised(self) -> int:
        """Bytes set aside for it."""
        if self._came < _TRICKLE_BYTES_PER_S * (monotonic() - self._began - _FIRST_S):
            self._promised = min(self._promised, self._came + _STEP)
        return self._promised

    async def watch(self, chunks: AsyncIterable[bytes]) -> AsyncIterator[bytes]:
        """Pass the part's bytes on; end when the disk has no room for them or for the rest."""
        looked_at = 0
        async for chunk in chunks:
            self._came += len(chunk)
            if self._came > self._promised:
                self._promised = min(max(self._size, self._came), self._came + _STEP)
                self.lost = await self._room.lacks()
            elif self._came - looked_at >= _LOOK_EVERY:
                looked_at = self._came
                self.lost = await self._room.lacks(self._promised - self._came)
            if self.lost is not None:
                return
            yield chunk
