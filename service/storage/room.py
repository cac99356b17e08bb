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
        """Room for ``size`` bytes until the block ends. Raises :class:`Problem` 507 ``disk_full``."""
        kept = Kept(self, size)
        self._promised += size
        try:
            if not await kept.is_there():
                raise disk_full(kept.free)
            yield kept
        finally:
            self._promised -= kept.to_come

    async def lacks(self) -> int | None:
        """What is free where it is too little for all that is promised; None where there is enough."""
        # A disk that hangs must not hang the event loop.
        free = await asyncio.to_thread(self._store.free_bytes)
        return free if free is not None and free - self._promised < self._reserve else None

    def came(self, size: int) -> None:
        """So many of the promised bytes are written."""
        self._promised -= size


class Kept:
    """The room of one part. ``lost``: it went while the bytes came, and the disk has ``free`` bytes left."""

    def __init__(self, room: Room, size: int) -> None:
        self._room = room
        self.to_come = size
        self.lost = False
        self.free = 0

    async def is_there(self) -> bool:
        """Whether the disk still has it."""
        free = await self._room.lacks()
        if free is not None:
            self.lost, self.free = True, free
        return not self.lost

    async def watch(self, chunks: AsyncIterable[bytes]) -> AsyncIterator[bytes]:
        """Pass the part's bytes on, and end where the disk has no room for them any more."""
        since = 0
        async for chunk in chunks:
            yield chunk
            passed = min(len(chunk), self.to_come)
            self.to_come -= passed
            self._room.came(passed)
            since += len(chunk)
            if since >= _LOOK_EVERY:
                since = 0
                if not await self.is_there():
                    return
