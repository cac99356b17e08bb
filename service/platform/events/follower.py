"""One stream of hints: its queue and the reason of its end."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from uuid import UUID

from apexcal.documents.roles import Role
from service.platform.auth.access import Identity
from service.platform.broker.hints import Hint

# A page that falls so far behind reads everything again anyway.
_MOST_WAITING = 100


class Follower:
    """Who follows a fleet, with the role that they had when they began, and the hints that wait for them."""

    def __init__(self, identity: Identity, fleet_id: UUID, role: Role) -> None:
        self.identity = identity
        self.fleet_id = fleet_id
        self.role = role
        self.gives_way = False
        self._waiting: asyncio.Queue[Hint | None] = asyncio.Queue(_MOST_WAITING)

    def tell(self, hint: Hint) -> None:
        """Put a hint behind those that wait. Where too many wait, one that says `anything` takes their place."""
        if self._waiting.full():
            self._put_only(anything(self.fleet_id))
        else:
            self._waiting.put_nowait(hint)

    def end(self, *, gives_way: bool = False) -> None:
        """End the stream; ``gives_way`` says that a newer one of the same person takes its place."""
        self.gives_way = gives_way
        self._put_only(None)

    async def hints(self, seconds: float, pause_s: float) -> AsyncIterator[Hint | None]:
        """Yield hints as they come, and None after each pause without one, for at most this many seconds."""
        clock = asyncio.get_running_loop().time
        end = clock() + seconds
        while clock() < end:
            try:
                async with asyncio.timeout_at(min(end, clock() + pause_s)):
                    hint = await self._waiting.get()
            except TimeoutError:
                yield None
                continue
            if hint is None:
                return
            yield hint

    def _put_only(self, hint: Hint | None) -> None:
        while not self._waiting.empty():
            self._waiting.get_nowait()
        self._waiting.put_nowait(hint)


def anything(fleet_id: UUID) -> Hint:
    """The hint that anything of a fleet may have changed."""
    return Hint(fleet_id, "fleet", str(fleet_id))
