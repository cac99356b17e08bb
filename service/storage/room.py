"""What a folder's disk has left for uploads, with all that is on its way to it at this moment."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, AsyncIterator
from contextlib import asynccontextmanager

from service.settings import MIB
from service.storage.problems import disk_full
from service.storage.store import Store

# The disk is looked at again after so many bytes of a part: others write to it too, and know nothing of ours.
_LOOK_EVERY = 8 * MIB


class Room:
    """One for an application, used from its event loop alone. ``reserve`` bytes of the disk stay free."""

    def __init__(self, store: Store, reserve: int) -> None:
        self._store = store
        self._reserve = reserve
        self._promised = 0

    @asynccontextmanager
    async def kept_for(self, size: int) -> AsyncIterator[Kept]:
        """Room for ``size`` bytes until the block ends. Raises :class:`Problem` 507 ``disk_full``.

        What is on its way counts whole until it is there: nobody knows how much of it lies in buffers.
        """
        self._promised += size
        try:
            free = await self.lacks(self._promised)
            if free is not None:
                raise disk_full(free)
            yield Kept(self, size)
        finally:
            self._promised -= size

    async def lacks(self, size: int) -> int | None:
        """What is free, where that is too little for ``size`` bytes; None where there is enough."""
        # A disk that hangs must not hang the event loop.
        free = await asyncio.to_thread(self._store.free_bytes)
        return free if free is not None and free - size < self._reserve else None


class Kept:
    """The room of one part. ``lost`` says what the disk had left where it went while the part's bytes came."""

    def __init__(self, room: Room, size: int) -> None:
        self._room = room
        self._to_come = size
        self.lost: int | None = None

    async def watch(self, chunks: AsyncIterable[bytes]) -> AsyncIterator[bytes]:
        """Pass the part's bytes on, and end where the disk has no room for the rest any more."""
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
