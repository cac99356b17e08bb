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
        self._promised = 0

    @asynccontextmanager
    async def kept_for(self, size: int) -> AsyncIterator[Kept]:
        """Room for ``size`` bytes until the block ends. Raises :class:`StoreFullError`.

        A part counts whole until it has arrived: nobody knows how much of it lies in buffers.
        """
        self._promised += size
        try:
            free = await self.lacks(self._promised)
            if free is not None:
                raise StoreFullError(free)
            yield Kept(self, size)
        finally:
            self._promised -= size

    async def lacks(self, size: int) -> int | None:
        """What is free, where that is too little for ``size`` bytes; None where there is enough."""
        # A disk that hangs must not hang the event loop.
        free = await asyncio.to_thread(self._store.free_bytes)
        return free if free is not None and free - size < self._reserve else None


class Kept:
    """The room of one part. ``lost`` is what the disk had free when it got too full while the bytes came."""

    def __init__(self, room: Room, size: int) -> None:
        self._room = room
        self._to_come = size
        self.lost: int | None = None

    async def watch(self, chunks: AsyncIterable[bytes]) -> AsyncIterator[bytes]:
        """Pass the part's bytes on; end when the disk has no room for the rest."""
        since = 0
        async for chunk in chunks:
            yield chunk
            self._to_come = max(0, self._to_come - len(chunk))
            since += len(chunk)
            if since >= _LOOK_EVERY:
                since = 0
                self.lost = await self._room.lacks(self._to_come)
                if self.lost is not None:
                    return
