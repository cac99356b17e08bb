"""Free disk space for uploads, less what is being uploaded now."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, AsyncIterator
from contextlib import asynccontextmanager

from service.platform.settings import MIB
from service.platform.storage.errors import StoreFullError
from service.platform.storage.store import Store

# The disk is looked at again after so many bytes of a part, because others write to it too.
_LOOK_EVERY = 8 * MIB


class Room:
    """One object for an application, used from its event loop alone. ``reserve`` bytes of the disk stay free."""

    def __init__(self, store: Store, reserve: int) -> None:
        self._store = store
        self._reserve = reserve
        self.promised = 0

    @asynccontextmanager
    async def kept_for(self, size: int) -> AsyncIterator[Kept]:
        """Room for a part of ``size`` bytes until the block ends. Raises :class:`StoreFullError`.

        It grows with what arrives, so that a part that trickles takes nothing from others. What came counts until the
        end: nobody knows how much of it lies in buffers.
        """
        reservation = Kept(self, size)
        try:
            free = await reservation.grow()
            if free is not None:
                raise StoreFullError(free)
            yield reservation
        finally:
            self.promised -= reservation.promised

    async def lacks(self) -> int | None:
        """What is free, where that is too little for all that is promised; None where there is enough."""
        # A disk that hangs must not hang the event loop.
        free = await asyncio.to_thread(self._store.free_bytes)
        return free if free is not None and free - self.promised < self._reserve else None


class Kept:
    """The room of one part. ``lost`` is what the disk had free when it got too full while the bytes came."""

    def __init__(self, room: Room, size: int) -> None:
        self._room = room
        self._size = size
        self.promised = 0
        self.lost: int | None = None

    async def grow(self) -> int | None:
        """Promise the part its next bytes; what is free, where that is too little."""
        more = min(_LOOK_EVERY, self._size - self.promised)
        self.promised += more
        self._room.promised += more
        return await self._room.lacks()

    async def watch(self, chunks: AsyncIterable[bytes]) -> AsyncIterator[bytes]:
        """Pass the part's bytes on; end when the disk has no room for the next ones."""
        came = 0
        async for chunk in chunks:
            yield chunk
            came += len(chunk)
            if came >= self.promised and self.promised < self._size:
                self.lost = await self.grow()
                if self.lost is not None:
                    return
